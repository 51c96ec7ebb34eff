// What `waymark eval` prints.
#pragma once

#include <optional>
#include <string>

#include "tools/evaluation/accuracy_limit.h"
#include "tools/evaluation/evaluation.h"

namespace waymark::tools {

// Whatever was asked for.
struct Evaluation {
  std::optional<TrajectoryErrors> trajectory;
  std::optional<ViewCoverage> coverage;
  std::optional<MapErrors> map;
  std::optional<AccuracyLimit> limit;
};

[[nodiscard]] std::string plainText(const Evaluation& evaluation);
// A JSON object with the keys of what was asked for.
[[nodiscard]] std::string jsonText(const Evaluation& evaluation);

}  // namespace waymark::tools
