#pragma once

#include "tests/support/report_program.hpp"

namespace fathom::bench {

using test::required;

// The subcommands of fathom-report; each stands beside what it measures.
[[nodiscard]] test::Report accuracyReport();
[[nodiscard]] test::Report camerasReport();
[[nodiscard]] test::Report closureReport();
[[nodiscard]] test::Report colmapReport();
[[nodiscard]] test::Report enduranceReport();
[[nodiscard]] test::Report fusionReport();
[[nodiscard]] test::Report growthReport();
[[nodiscard]] test::Report hostileReport();
[[nodiscard]] test::Report lightingReport();
[[nodiscard]] test::Report linkReport();
[[nodiscard]] test::Report overlapReport();
[[nodiscard]] test::Report realtimeReport();
[[nodiscard]] test::Report recorderReport();
[[nodiscard]] test::Report restartReport();
[[nodiscard]] test::Report slamReport();
[[nodiscard]] test::Report stereoReport();

}  // namespace fathom::bench
