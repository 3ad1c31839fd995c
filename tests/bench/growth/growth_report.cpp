// Time and memory of fathom-topside over the number of pairs: whole missions and parts of them, with several
// numbers of jobs. Writes growth.html and growth.json, anew after each run.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>

#include "realtime/kernel/input_error.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/growth/measured_run.hpp"
#include "tests/bench/growth/mission_part.hpp"
#include "tests/bench/reports.hpp"

namespace fathom::growth {
namespace {

using bench::cell;

constexpr double kMiB = 1024.0 * 1024.0;

// Runs of one source and number of jobs, by pairs.
using Series = std::map<std::pair<std::string, int>, std::vector<const GrowthRun*>>;

Series seriesOf(const std::vector<GrowthRun>& runs) {
  Series series;
  for (const GrowthRun& run : runs) series[{run.source, run.jobs}].push_back(&run);
  for (auto& [key, list] : series)
    std::sort(list.begin(), list.end(),
              [](const GrowthRun* a, const GrowthRun* b) { return a->pairs < b->pairs; });
  return series;
}

std::vector<std::string> stageNames(const std::vector<GrowthRun>& runs) {
  std::vector<std::string> names;
  for (const GrowthRun& run : runs)
    for (const auto& [name, seconds] : run.stages_s)
      if (std::find(names.begin(), names.end(), name) == names.end()) names.push_back(name);
  return names;
}

double secondsOf(const GrowthRun& run, const std::string& stage) {
  for (const auto& [name, seconds] : run.stages_s)
    if (name == stage) return seconds;
  return 0;
}

double countOf(const GrowthRun& run) {
  return static_cast<double>(run.pairs);
}

std::string label(const std::string& source, int jobs) {
  return source + ", " + std::to_string(jobs) + (jobs == 1 ? " job" : " jobs");
}

// `value` of every series over pairs; `proportional`: a dashed line from nought through each series' last.
template <typename Value>
web::Plot curves(const Series& series, const std::string& source, const std::string& title,
                 const std::string& unit, bool proportional, Value value) {
  web::Plot plot{.title = title, .x = "pairs", .y = unit, .width = web::kHalfPage};
  std::size_t colour = 0;
  for (const auto& [key, list] : series) {
    if (key.first != source) continue;
    const char* const ink = web::distinctColour(colour++);
    web::Series line{.label = label(key.first, key.second), .colour = ink, .at = {{0, 0}}, .size = 2};
    line.lift();
    for (const GrowthRun* run : list) line.at.emplace_back(countOf(*run), value(*run));
    if (proportional) plot.series.push_back({.colour = ink, .at = {{0, 0}, line.at.back()}, .dashed = true});
    plot.series.push_back(std::move(line));
  }
  return plot;
}

// Milliseconds a pair, stage over stage; a bar a run, in order of pairs.
web::Plot stagesPlot(const std::vector<const GrowthRun*>& list, const std::vector<std::string>& names,
                     const std::string& title) {
  web::Plot plot{
      .title = title, .x = "runs, in order of pairs", .y = "wall time a pair [ms]", .width = web::kHalfPage};
  std::vector<double> at(list.size(), 0);
  for (std::size_t k = 0; k < names.size(); ++k) {
    web::Series stage{.label = names[k], .kind = web::Series::Kind::kAreas, .colour = web::distinctColour(k)};
    for (std::size_t i = 0; i < list.size(); ++i) {
      const double ms = 1e3 * secondsOf(*list[i], names[k]) / countOf(*list[i]);
      if (ms <= 0) continue;
      const auto x = static_cast<double>(i);
      stage.rectangle({x + 0.65, at[i]}, {x + 1.35, at[i] + ms});
      at[i] += ms;
    }
    if (!stage.at.empty()) plot.series.push_back(std::move(stage));
  }
  return plot;
}

bench::Table runsTable(const std::vector<GrowthRun>& runs) {
  const std::vector<std::string> names = stageNames(runs);
  bench::Table table{"Runs",
                     {{"mission", 0},
                      {"source", 0},
                      {"pairs", 0},
                      {"jobs", 0},
                      {"wall [s]", 3},
                      {"CPU [s]", 3},
                      {"wall a pair [s]", 5},
                      {"peak resident [MiB]", 1},
                      {"peak anonymous [MiB]", 1},
                      {"peak of all [MiB]", 1},
                      {"results [bytes]", 0}},
                     {}};
  for (const std::string& name : names) table.columns.push_back({name + " [s]", 3});
  for (const GrowthRun& r : runs) {
    const ProcessCost& c = r.cost;
    table.rows.push_back({r.mission, r.source, cell(r.pairs), cell(r.jobs), c.wall_s, c.cpu_s,
                          c.wall_s / countOf(r), static_cast<double>(c.peak_resident) / kMiB,
                          static_cast<double>(c.peak_anonymous) / kMiB,
                          static_cast<double>(c.peak_all) / kMiB, cell(r.result_bytes)});
    for (const std::string& name : names) table.rows.back().emplace_back(secondsOf(r, name));
  }
  return table;
}

// Time = a pairs^exponent, by least squares of logarithms. 1 is linear.
bench::Table growthTable(const std::vector<GrowthRun>& runs) {
  bench::Table table{"Time grows as pairs^exponent",
                     {{"source", 0}, {"jobs", 0}, {"exponent", 3}, {"a pair of the longest [s]", 4}},
                     {}};
  for (const auto& [key, list] : seriesOf(runs)) {
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (const GrowthRun* run : list) {
      const double a = std::log(countOf(*run)), b = std::log(run->cost.wall_s);
      n += 1, x += a, y += b, xx += a * a, xy += a * b;
    }
    const double spread = n * xx - x * x;
    table.rows.push_back({key.first, cell(key.second),
                          spread > 1e-9 ? (n * xy - x * y) / spread : std::nan(""),
                          list.back()->cost.wall_s / countOf(*list.back())});
  }
  return table;
}

// Time, memory, and time a pair by stage over the number of pairs.
void addPlots(const std::vector<GrowthRun>& runs, web::Report& report) {
  const Series series = seriesOf(runs);
  const std::vector<std::string> names = stageNames(runs);
  std::set<std::string> sources;
  for (const auto& [key, list] : series) sources.insert(key.first);
  for (const std::string& source : sources) {
    report.plot(curves(series, source, source + ": wall time (dashed: in proportion)", "[s]", true,
                       [](const GrowthRun& r) { return r.cost.wall_s; }));
    report.plot(curves(series, source, source + ": peak memory of a process, resident", "[MiB]", false,
                       [](const GrowthRun& r) { return static_cast<double>(r.cost.peak_resident) / kMiB; }));
    const auto longest =
        std::find_if(series.rbegin(), series.rend(), [&](const auto& s) { return s.first.first == source; });
    report.plot(stagesPlot(longest->second, names, label(source, longest->first.second) + ": by stage"));
  }
}

struct Options {
  std::vector<std::filesystem::path> missions;
  std::vector<std::size_t> parts;
  std::vector<int> jobs = {1, 2};
  std::filesystem::path out, program = FATHOM_BIN_DIR "/fathom-topside";
};

int run(const Options& o) {
  std::vector<GrowthRun> runs;
  for (const auto& mission : o.missions) {
    const std::size_t all = pairsOf(mission);
    std::vector<std::size_t> sizes = o.parts;
    std::erase_if(sizes, [all](std::size_t n) { return n > all; });
    if (sizes.empty()) sizes.push_back(all);
    for (const std::size_t pairs : sizes) {
      const auto part =
          o.out / "missions" /
          (std::filesystem::canonical(mission).filename().string() + "-" + std::to_string(pairs));
      makePart(mission, pairs, part);
      for (const int jobs : o.jobs) {
        std::fprintf(stderr, "%s, %d jobs\n", part.filename().c_str(), jobs);
        runs.push_back(
            runPipeline(o.program, part, jobs,
                        o.out / "runs" / (part.filename().string() + "-jobs" + std::to_string(jobs))));
        bench::Page page("Time and memory of fathom-topside");
        page.add(runsTable(runs));
        page.add(growthTable(runs));
        addPlots(runs, page.report());
        page.write(o.out, "growth");
      }
    }
  }
  std::printf("%s\n%s", runsTable(runs).text().c_str(), growthTable(runs).text().c_str());
  return kExitSuccess;
}

}  // namespace
}  // namespace fathom::growth

namespace fathom::bench {

test::Report growthReport() {
  static growth::Options o;
  return {"growth",
          "Time and memory of fathom-topside over the number of pairs",
          {required({"missions", &o.missions, "mission folders"}),
           required({"--out", &o.out, "folder for the results; what is run is kept there too"}),
           {"--parts", &o.parts,
            "first so many pairs of the missions with at least as many; none: whole missions"},
           {"--jobs", &o.jobs, "numbers of jobs"},
           {"--program", &o.program, "fathom-topside to measure"}},
          [] { return growth::run(o); }};
}

}  // namespace fathom::bench
