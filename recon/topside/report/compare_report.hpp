#pragma once

#include <filesystem>
#include <string>

#include "recon/compare/compare.hpp"

namespace fathom::topside {

[[nodiscard]] std::string comparisonJson(const compare::Comparison& comparison);
// A few lines for the terminal.
[[nodiscard]] std::string comparisonText(const compare::Comparison& comparison);
// difference.tif, difference.png, survey.png, reference.png, compare.json and compare.html, in `folder`.
void writeComparison(const compare::Comparison& comparison, const std::filesystem::path& folder);

}  // namespace fathom::topside
