#pragma once

#include <gmock/gmock.h>
#include <sys/wait.h>

#include <cstdlib>
#include <sstream>
#include <vector>

#include "tests/support/test_data.hpp"

namespace fathom::test {

// How a file can be bad. kHalf keeps its first half.
enum class Damage { kAbsent, kEmpty, kFolder, kHalf, kNonsense };
inline constexpr Damage kEveryDamage[] = {Damage::kAbsent, Damage::kEmpty, Damage::kFolder, Damage::kHalf,
                                          Damage::kNonsense};

inline void damage(const std::filesystem::path& path, Damage kind) {
  const std::string good = std::filesystem::is_regular_file(path) ? readText(path) : "";
  std::filesystem::remove(path);
  if (kind == Damage::kEmpty) writeText(path, "");
  if (kind == Damage::kFolder) std::filesystem::create_directory(path);
  if (kind == Damage::kHalf) writeText(path, good.substr(0, good.size() / 2));
  if (kind != Damage::kNonsense) return;
  std::string noise;
  for (std::uint32_t i = 0, x = 12345; i < 5000; ++i) {
    x = x * 1664525 + 1013904223;  // Numerical Recipes' generator
    noise.push_back(static_cast<char>(x >> 24));
  }
  writeText(path, noise);
}

struct Outcome {
  int exit_code = -1;  // -1: ended by a signal
  std::string out, err;
};

inline std::vector<std::string> linesOf(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

// With a shell's quoting and redirections.
inline Outcome runCommand(const std::string& command) {
  const TemporaryFolder streams;
  const auto out = streams.path() / "out", err = streams.path() / "err";
  const std::string line = "{ " + command + "; } >" + out.string() + " 2>" + err.string() + " </dev/null";
  const int status = std::system(line.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, readText(out), readText(err)};
}

// Of this build: "fathom-sim score x".
inline Outcome runProgram(const std::string& command) {
  return runCommand(std::string(FATHOM_BIN_DIR) + "/" + command);
}

// Bad input: exit code 2, nothing half-written, and one line, which names the program and `subject`.
inline void expectRefused(const std::string& command, const std::string& subject) {
  SCOPED_TRACE(command);
  const Outcome run = runProgram(command);
  EXPECT_EQ(run.exit_code, 2) << run.err;
  EXPECT_EQ(run.out, "");
  ASSERT_EQ(linesOf(run.err).size(), 1u) << run.err;
  EXPECT_EQ(run.err.rfind(command.substr(0, command.find(' ')) + ": ", 0), 0u) << run.err;
  EXPECT_THAT(run.err, ::testing::HasSubstr(subject));
}

}  // namespace fathom::test
