#include "sim/score_command.hpp"

#include <cstdio>

#include "realtime/kernel/input_error.hpp"
#include "sim/score/score.hpp"

namespace fathom::sim {

int runScore(const std::filesystem::path& mission, const std::vector<std::filesystem::path>& surfaces,
             bool json) {
  const ScoreReport report = scoreMission(mission, surfaces);
  for (const std::string& note : report.notes) std::fprintf(stderr, "note: %s\n", note.c_str());
  std::printf("%s\n", json ? scoreJson(report).c_str() : scoreTable(report).c_str());
  return kExitSuccess;
}

}  // namespace fathom::sim
