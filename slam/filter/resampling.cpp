#include "slam/filter/resampling.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace submapd {

double normalise_weights(std::span<const double> log_weights, std::span<double> weights) {
  double top = -std::numeric_limits<double>::infinity();
  for (const double l : log_weights) top = std::max(top, std::isfinite(l) ? l : top);
  double sum = 0.0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const double l = log_weights[i];
    weights[i] = std::isfinite(l) && std::isfinite(top) ? std::exp(l - top) : 0.0;
    sum += weights[i];
  }
  const auto n = static_cast<double>(weights.size());
  double square_sum = 0.0;
  for (double& w : weights) {
    w = sum > 0.0 ? w / sum : 1.0 / n;
    square_sum += w * w;
  }
  return 1.0 / square_sum;
}

void resample_systematic(std::span<const double> weights, CounterRandom& random, std::span<int> ancestors) {
  const double step = 1.0 / static_cast<double>(ancestors.size());
  double pointer = random.uniform() * step;
  double cumulative = weights[0];
  std::size_t i = 0;
  for (int& ancestor : ancestors) {
    while (cumulative <= pointer && i + 1 < weights.size()) cumulative += weights[++i];
    ancestor = static_cast<int>(i);
    pointer += step;
  }
}

void resample_wheel(std::span<const double> weights, CounterRandom& random, std::span<int> ancestors) {
  const std::size_t n = weights.size();
  const double largest = *std::max_element(weights.begin(), weights.end());
  auto index = static_cast<std::size_t>(random.uniform() * static_cast<double>(n)) % n;
  double beta = 0.0;
  for (int& ancestor : ancestors) {
    beta += random.uniform() * 2.0 * largest;
    while (beta > weights[index]) {
      beta -= weights[index];
      index = (index + 1) % n;
    }
    ancestor = static_cast<int>(index);
  }
}

}  // namespace submapd
