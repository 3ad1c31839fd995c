// Time and memory of fathom-topside over the number of pairs: whole missions and parts of them, with several
// numbers of jobs. Writes growth.csv, growth.json and growth.svg.
#include <CLI/CLI.hpp>
#include <cstdio>

#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "tests/bench/growth/growth_page.hpp"
#include "tests/bench/growth/mission_part.hpp"

namespace {

void write(const std::filesystem::path& path, const std::string& text) {
  fathom::AtomicFile file(path);
  file.stream() << text;
  file.commit();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Time and memory of fathom-topside over the number of pairs");
  std::vector<std::filesystem::path> missions;
  std::vector<std::size_t> parts;
  std::vector<int> jobs = {1, 2};
  std::filesystem::path out, program = FATHOM_BIN_DIR "/fathom-topside";
  app.add_option("missions", missions, "mission folders")->required();
  app.add_option("--out", out, "folder for the results; what is run is kept there too")->required();
  app.add_option("--parts", parts,
                 "first so many pairs of the missions with at least as many; none: whole missions")
      ->delimiter(',');
  app.add_option("--jobs", jobs, "numbers of jobs")->delimiter(',')->capture_default_str();
  app.add_option("--program", program, "fathom-topside to measure")->capture_default_str();
  if (const auto code = fathom::parseCommandLine("report_growth", app, argc, argv)) return *code;
  return fathom::runTool("report_growth", [&]() -> int {
    using namespace fathom::growth;
    std::filesystem::create_directories(out);
    std::vector<GrowthRun> runs;
    for (const auto& mission : missions) {
      const std::size_t all = pairsOf(mission);
      std::vector<std::size_t> sizes = parts;
      std::erase_if(sizes, [all](std::size_t n) { return n > all; });
      if (sizes.empty()) sizes.push_back(all);
      for (const std::size_t pairs : sizes) {
        const auto part =
            out / "missions" /
            (std::filesystem::canonical(mission).filename().string() + "-" + std::to_string(pairs));
        makePart(mission, pairs, part);
        for (const int n : jobs) {
          runs.push_back(runPipeline(
              program, part, n, out / "runs" / (part.filename().string() + "-jobs" + std::to_string(n))));
          const GrowthRun& run = runs.back();
          std::printf("%s, %d jobs: %.1f s (%.4f a pair), %.0f MiB resident\n", run.mission.c_str(), n,
                      run.cost.wall_s, run.cost.wall_s / static_cast<double>(run.pairs),
                      static_cast<double>(run.cost.peak_resident) / (1024.0 * 1024.0));
          std::fflush(stdout);
          write(out / "growth.csv", toCsv(runs));
        }
      }
    }
    write(out / "growth.json", toJson(runs));
    write(out / "growth.svg", toSvg(runs));
    for (const Growth& g : growthOf(runs))
      std::printf("%s, %d jobs: time grows as pairs^%.3f, %.4f s a pair\n", g.source.c_str(), g.jobs,
                  g.exponent, g.s_per_pair);
    return fathom::kExitSuccess;
  });
}
