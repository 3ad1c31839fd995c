// onboard_kill: the report by itself, as a test runs it.
#include "tests/onboard/kill/kill_report.hpp"

int main(int argc, char** argv) {
  using namespace fathom;
  CommandLine app("Kills the live program, or cuts its machine's power");
  for (const auto add : {test::killReport, test::killedDive, test::powerReport}) add(app);
  return app.run("onboard_kill", argc, argv);
}
