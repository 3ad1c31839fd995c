#pragma once

#include <string>

#include "tests/support/program_run.hpp"
#include "tests/uml/machine_files.hpp"

// Calls uml_run from a test. The test's target depends on uml_run and is defined by fathom_test.
namespace fathom::uml {

// Begin a test with this, so that it skips, saying so, where there is none.
#define FATHOM_REQUIRE_USER_MODE_LINUX()                                                            \
  if (const auto tried = fathom::uml::runMachine("-- true"); tried.status == fathom::uml::kSkipped) \
  GTEST_SKIP() << tried.output

// The same for tests that run a program of this build inside: a sanitizer's shadow memory does not fit there.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define FATHOM_REQUIRE_OWN_PROGRAMS_INSIDE() \
  GTEST_SKIP() << "programs with a sanitizer do not start inside the user-mode Linux"
#else
#define FATHOM_REQUIRE_OWN_PROGRAMS_INSIDE() FATHOM_REQUIRE_USER_MODE_LINUX()
#endif

struct MachineRun {
  int status = -1;     // of uml_run
  std::string output;  // the command's and uml_run's, stdout and stderr
};

// `arguments` as a shell reads them: "--can -- candump vcan0".
inline MachineRun runMachine(const std::string& arguments) {
  const test::Outcome run = test::runProgram("uml_run " + arguments);
  return {run.exit_code, run.out + run.err};
}

}  // namespace fathom::uml
