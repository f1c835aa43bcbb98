// Resampling of weighted particles (design notes 6.3): which ancestor each new particle copies.
#pragma once

#include <cstdint>
#include <span>

#include "slam/base/random.hpp"

namespace submapd {

// Normalises log weights in place to weights that sum to 1, safely for any magnitude; returns N_eff = 1 / sum w^2.
// All minus infinity gives equal weights.
double normalise_weights(std::span<const double> log_weights, std::span<double> weights);

// Systematic: one random number, lowest variance; ancestors ascend. REQUIRES: equal sizes, weights sum to 1.
void resample_systematic(std::span<const double> weights, CounterRandom& random, std::span<int> ancestors);

// The textbook's "resampling wheel": same expectation, more variance; the baseline mode uses it.
void resample_wheel(std::span<const double> weights, CounterRandom& random, std::span<int> ancestors);

}  // namespace submapd
