#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace fathom::growth {

// What a program took, with all processes that it started.
struct ProcessCost {
  int exit_code = 0;
  double wall_s = 0, cpu_s = 0;      // user and system
  std::uint64_t peak_resident = 0;   // of its largest process, with mapped files [bytes]
  std::uint64_t peak_anonymous = 0;  // of its largest process, without them [bytes]
  std::uint64_t peak_all = 0;        // resident, of all of them at one time [bytes]
};

// Runs argv[0] with these arguments; output and errors go to the file `output`. Looks five times a second.
[[nodiscard]] ProcessCost runMeasured(const std::vector<std::string>& argv,
                                      const std::filesystem::path& output);

// One run of the pipeline.
struct GrowthRun {
  std::string mission, source;  // "images" or "features"
  std::size_t pairs = 0;
  int jobs = 1;
  ProcessCost cost;
  std::uint64_t result_bytes = 0;                        // of the folder of results
  std::vector<std::pair<std::string, double>> stages_s;  // wall clock, in order
};

// Runs `program run mission --jobs N` into fresh folders under `scratch` and reads its report. Throws
// std::runtime_error when the run fails.
[[nodiscard]] GrowthRun runPipeline(const std::filesystem::path& program,
                                    const std::filesystem::path& mission, int jobs,
                                    const std::filesystem::path& scratch);

}  // namespace fathom::growth
