#pragma once

#include "tests/support/report_program.hpp"

namespace fathom::bench {

using test::required;

// The subcommands of fathom-report.
[[nodiscard]] test::Report camerasReport();
[[nodiscard]] test::Report closureReport();
[[nodiscard]] test::Report colmapReport();
[[nodiscard]] test::Report enduranceReport();
[[nodiscard]] test::Report fusionReport();
[[nodiscard]] test::Report hostileReport();
[[nodiscard]] test::Report linkReport();
[[nodiscard]] test::Report realtimeReport();
[[nodiscard]] test::Report recorderReport();
[[nodiscard]] test::Report restartReport();
[[nodiscard]] test::Report slamReport();
[[nodiscard]] test::Report stereoReport();

}  // namespace fathom::bench
