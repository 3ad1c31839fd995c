// fathom-report: measures Fathom as a whole, against truth or a peer.
#include "tests/bench/reports.hpp"
#include "tests/onboard/kill/kill_report.hpp"
#include "tests/uml/power_cut_report.hpp"

int main(int argc, char** argv) {
  using namespace fathom;
  using namespace fathom::bench;
  CommandLine app("Measures Fathom as a whole: a table on stdout, and pages where --out names a folder");
  for (const auto add :
       {stereoReport, closureReport, matchErrorReport, colmapReport, fusionReport, slamReport, hostileReport,
        linkReport, realtimeReport, enduranceReport, recorderReport, uml::powerCutReport, test::killReport,
        test::killedDive, restartReport, camerasReport})
    add(app);
  return app.run("fathom-report", argc, argv);
}
