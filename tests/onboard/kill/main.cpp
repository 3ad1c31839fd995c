// onboard_kill: the report by itself, as a test runs it.
#include "tests/onboard/kill/kill_report.hpp"

int main(int argc, char** argv) {
  using namespace fathom::test;
  return runReports("onboard_kill", {killReport(), killedDive(), powerReport()}, argc, argv);
}
