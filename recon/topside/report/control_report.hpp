#pragma once

#include <optional>
#include <string>
#include <vector>

#include "recon/topside/localise/control_network.hpp"
#include "telemetry/web/report_fields.hpp"

namespace fathom::topside {

// What control points, check points and scale bars came to: as report.json and slam.json hold it, as a
// section of a page, in one sentence, and what is wrong with them, a sentence each. Nothing without any.
[[nodiscard]] nlohmann::ordered_json controlJson(const ControlResult& control);
void addControl(web::ReportPage& report, const ControlResult& control);
[[nodiscard]] std::optional<std::string> controlSentence(const ControlResult& control);
[[nodiscard]] std::vector<std::string> controlWarnings(const ControlResult& control);

}  // namespace fathom::topside
