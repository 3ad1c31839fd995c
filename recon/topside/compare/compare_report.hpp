#pragma once

#include <filesystem>
#include <string>

#include "recon/topside/compare/compare.hpp"

namespace fathom::topside::compare {

[[nodiscard]] std::string comparisonJson(const Comparison& comparison);
// A few lines for the terminal.
[[nodiscard]] std::string comparisonText(const Comparison& comparison);
// difference.tif, difference.png, survey.png, reference.png, compare.json and compare.html, in `folder`.
void writeComparison(const Comparison& comparison, const std::filesystem::path& folder);

}  // namespace fathom::topside::compare
