// report.json of a saved map (saved-map.md): its quality as far as it can be told without a truth.
//
// Pure function; any thread.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "slam/graph/optimizer.hpp"
#include "slam/output/run_quality.hpp"

namespace submapd {

[[nodiscard]] nlohmann::json quality_report(const RunQuality& quality, const FinalResult& result);

}  // namespace submapd
