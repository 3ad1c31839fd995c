#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "recon/topside/localise/slam_stage.hpp"
#include "recon/topside/report/consistency.hpp"

namespace fathom::topside {

// The counts of localisation, as report.json and slam.json hold them; and how it compares with a truth.
[[nodiscard]] nlohmann::ordered_json slamJson(const SlamResult& slam);
// What whoever uses the poses must know, a sentence each: no convergence, crossings that were not verified,
// extrinsics or clocks that cannot be right.
[[nodiscard]] std::vector<std::string> slamWarnings(const SlamResult& slam);
// What the images say of extrinsics, clocks and the USBL, with standard deviations: names and values to show.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> calibrationRows(const SlamResult& slam);
// The same of the bundle adjustment; none where there was none.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> bundleRows(const SlamResult& slam);
[[nodiscard]] nlohmann::ordered_json truthJson(const Consistency& consistency);

}  // namespace fathom::topside
