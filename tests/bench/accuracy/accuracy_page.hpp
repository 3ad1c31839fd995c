#pragma once

#include <optional>
#include <string>

#include "tests/bench/accuracy/fusion_variants.hpp"
#include "tests/bench/accuracy/model_accuracy.hpp"

namespace fathom::accuracy {

// What was measured of one mission; either part may be missing.
struct AccuracyReport {
  std::string mission;
  std::optional<ModelAccuracy> model;
  std::optional<VariantReport> variants;
};

[[nodiscard]] std::string toJson(const AccuracyReport& report);
[[nodiscard]] std::string toText(const AccuracyReport& report);
[[nodiscard]] std::string toHtml(const AccuracyReport& report);

}  // namespace fathom::accuracy
