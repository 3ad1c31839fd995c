#include "tests/bench/growth/measured_run.hpp"

#include <sys/resource.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "sim/hil/bench/child_process.hpp"
#include "tests/bench/common/measures.hpp"

namespace fathom::growth {
namespace {

namespace fs = std::filesystem;

// A line "Name:   123 kB" of /proc/<pid>/status, in bytes; 0 without it.
struct MemoryNow {
  std::uint64_t resident = 0, highest = 0, anonymous = 0;
};

MemoryNow memoryOf(int pid) {
  MemoryNow now;
  std::ifstream status("/proc/" + std::to_string(pid) + "/status");
  std::string line;
  while (std::getline(status, line)) {
    const auto bytes = [&] { return 1024 * std::strtoull(line.c_str() + line.find(':') + 1, nullptr, 10); };
    if (line.starts_with("VmRSS:")) now.resident = bytes();
    if (line.starts_with("VmHWM:")) now.highest = bytes();
    if (line.starts_with("RssAnon:")) now.anonymous = bytes();
  }
  return now;
}

// A process and all that descend from it.
std::vector<int> familyOf(int pid) {
  std::vector<int> family = {pid};
  for (std::size_t i = 0; i < family.size(); ++i) {
    std::error_code error;
    const fs::path tasks = "/proc/" + std::to_string(family[i]) + "/task";
    for (fs::directory_iterator it(tasks, error), end; !error && it != end; it.increment(error)) {
      std::ifstream children(it->path() / "children");
      for (int child = 0; children >> child;) family.push_back(child);
    }
  }
  return family;
}

std::uint64_t bytesIn(const fs::path& folder) {
  std::uint64_t bytes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) bytes += entry.file_size();
  return bytes;
}

}  // namespace

ProcessCost runMeasured(const std::vector<std::string>& argv, const fs::path& output) {
  const auto cpuOfChildren = [] {
    rusage usage{};
    ::getrusage(RUSAGE_CHILDREN, &usage);
    const auto seconds = [](const timeval& t) {
      return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
    };
    return seconds(usage.ru_utime) + seconds(usage.ru_stime);
  };
  constexpr double kLook_s = 0.2;
  ProcessCost cost;
  const double begin_ms = bench::wallMs(), cpu_before = cpuOfChildren();
  sim::ChildProcess child({argv, {}, output, std::nullopt});
  std::optional<int> status;
  while (!(status = child.wait(kLook_s))) {
    std::uint64_t all = 0;
    for (const int member : familyOf(child.pid())) {
      const MemoryNow now = memoryOf(member);
      cost.peak_resident = std::max(cost.peak_resident, now.highest);
      cost.peak_anonymous = std::max(cost.peak_anonymous, now.anonymous);
      all += now.resident;
    }
    cost.peak_all = std::max(cost.peak_all, all);
  }
  cost.wall_s = 1e-3 * (bench::wallMs() - begin_ms);
  cost.cpu_s = cpuOfChildren() - cpu_before;
  cost.exit_code = *status;
  return cost;
}

GrowthRun runPipeline(const fs::path& program, const fs::path& mission, int jobs, const fs::path& scratch) {
  fs::remove_all(scratch);
  fs::create_directories(scratch);
  const fs::path results = scratch / "topside", log = scratch / "output.log";
  GrowthRun run;
  run.mission = mission.filename().string();
  run.jobs = jobs;
  run.cost = runMeasured({program.string(), "run", mission.string(), "--jobs", std::to_string(jobs), "--out",
                          results.string(), "--work", (scratch / "work").string()},
                         log);
  if (run.cost.exit_code != 0)
    throw std::runtime_error(program.string() + " ended with " + std::to_string(run.cost.exit_code) +
                             "; see " + log.string());
  const auto report = nlohmann::ordered_json::parse(std::ifstream(results / "report.json"));
  run.source = report.value("source", "images");
  run.pairs = report.at("pairs").at("listed");
  for (const auto& [name, stage] : report.at("times").at("stages").items())
    run.stages_s.emplace_back(name, stage.at("seconds").get<double>());
  run.result_bytes = bytesIn(results);
  fs::remove_all(scratch / "work");
  return run;
}

}  // namespace fathom::growth
