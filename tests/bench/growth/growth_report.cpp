// Time and memory of fathom-topside over the number of pairs: whole missions and parts of them, with several
// numbers of jobs. Writes growth.html and growth.json, anew after each run.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>

#include "realtime/kernel/input_error.hpp"
#include "recon/topside/report/html_text.hpp"
#include "recon/topside/report/svg_plot.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/growth/measured_run.hpp"
#include "tests/bench/growth/mission_part.hpp"
#include "tests/bench/reports.hpp"

namespace fathom::growth {
namespace {

using bench::cell;
using topside::fixedDigits;
using topside::PlotAxes;
using topside::SvgPlot;

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
std::string curves(const Series& series, const std::string& source, const std::string& title,
                   const std::string& unit, bool proportional, Value value) {
  PlotAxes axes;
  axes.x_label = "pairs";
  axes.y_label = unit;
  axes.title = title;
  double top = 0, right = 0;
  for (const auto& [key, list] : series) {
    if (key.first != source) continue;
    for (const GrowthRun* run : list) {
      top = std::max(top, value(*run));
      right = std::max(right, countOf(*run));
    }
  }
  axes.right = 1.05 * std::max(right, 1.0);
  axes.top = 1.15 * std::max(top, 1e-9);
  SvgPlot plot(axes);
  std::size_t colour = 0;
  for (const auto& [key, list] : series) {
    if (key.first != source) continue;
    const std::string ink = topside::distinctColour(colour);
    std::vector<Eigen::Vector2d> line;
    for (const GrowthRun* run : list) line.emplace_back(countOf(*run), value(*run));
    plot.line(line, ink, 2);
    plot.dots(line, 4, ink);
    if (proportional) plot.line({{0, 0}, line.back()}, ink, 1, true);
    plot.text({0.16 * axes.right, (0.95 - 0.06 * static_cast<double>(colour)) * axes.top},
              label(key.first, key.second), ink, 12);
    ++colour;
  }
  return plot.svg();
}

// Milliseconds a pair, stage over stage.
std::string stagesPlot(const std::vector<const GrowthRun*>& list, const std::vector<std::string>& names,
                       const std::string& title) {
  PlotAxes axes;
  axes.x_label = "pairs (bars in order)";
  axes.y_label = "wall time a pair [ms]";
  axes.title = title;
  axes.right = static_cast<double>(list.size());
  double top = 0;
  for (const GrowthRun* run : list) {
    double sum = 0;
    for (const auto& [name, seconds] : run->stages_s) sum += seconds;
    top = std::max(top, 1e3 * sum / countOf(*run));
  }
  axes.top = 1.5 * std::max(top, 1e-9);
  SvgPlot plot(axes);
  for (std::size_t i = 0; i < list.size(); ++i) {
    double at = 0;
    for (std::size_t k = 0; k < names.size(); ++k) {
      const double ms = 1e3 * secondsOf(*list[i], names[k]) / countOf(*list[i]);
      if (ms <= 0) continue;
      const auto x = static_cast<double>(i);
      plot.rectangle({x + 0.15, at}, {x + 0.85, at + ms}, topside::distinctColour(k),
                     names[k] + " " + fixedDigits(ms, 2) + " ms");
      at += ms;
    }
    plot.text({static_cast<double>(i) + 0.5, at + 0.02 * axes.top}, std::to_string(list[i]->pairs));
  }
  double row = 0.96;
  for (std::size_t k = 0; k < names.size(); ++k) {
    if (std::none_of(list.begin(), list.end(),
                     [&](const GrowthRun* r) { return secondsOf(*r, names[k]) > 0; }))
      continue;
    plot.text({0.12 * axes.right, row * axes.top}, names[k], topside::distinctColour(k), 11);
    row -= 0.045;
  }
  return plot.svg();
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

// Time, memory, and time a pair by stage over the number of pairs, beside each other.
std::string svgOf(const std::vector<GrowthRun>& runs) {
  const Series series = seriesOf(runs);
  const std::vector<std::string> names = stageNames(runs);
  std::set<std::string> sources;
  for (const auto& [key, list] : series) sources.insert(key.first);
  std::vector<std::string> plots;
  for (const std::string& source : sources) {
    plots.push_back(curves(series, source, source + ": wall time (dashed: in proportion)", "[s]", true,
                           [](const GrowthRun& r) { return r.cost.wall_s; }));
    plots.push_back(
        curves(series, source, source + ": peak memory of a process, resident", "[MiB]", false,
               [](const GrowthRun& r) { return static_cast<double>(r.cost.peak_resident) / kMiB; }));
    const auto longest =
        std::find_if(series.rbegin(), series.rend(), [&](const auto& s) { return s.first.first == source; });
    plots.push_back(stagesPlot(longest->second, names, label(source, longest->first.second) + ": by stage"));
  }
  return topside::besideEachOther(plots, 3);
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
        page.html(svgOf(runs));
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
