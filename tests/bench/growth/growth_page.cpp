#include "tests/bench/growth/growth_page.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "recon/topside/report/html_text.hpp"
#include "recon/topside/report/svg_plot.hpp"

namespace fathom::growth {
namespace {

using Json = nlohmann::ordered_json;
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

double pairsOf(const GrowthRun& run) {
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
      right = std::max(right, pairsOf(*run));
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
    for (const GrowthRun* run : list) line.emplace_back(pairsOf(*run), value(*run));
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
    top = std::max(top, 1e3 * sum / pairsOf(*run));
  }
  axes.top = 1.5 * std::max(top, 1e-9);
  SvgPlot plot(axes);
  for (std::size_t i = 0; i < list.size(); ++i) {
    double at = 0;
    for (std::size_t k = 0; k < names.size(); ++k) {
      const double ms = 1e3 * secondsOf(*list[i], names[k]) / pairsOf(*list[i]);
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

}  // namespace

std::vector<Growth> growthOf(const std::vector<GrowthRun>& runs) {
  std::vector<Growth> out;
  for (const auto& [key, list] : seriesOf(runs)) {
    Growth g{key.first, key.second, 0, list.back()->cost.wall_s / pairsOf(*list.back())};
    double n = 0, x = 0, y = 0, xx = 0, xy = 0;
    for (const GrowthRun* run : list) {
      const double a = std::log(pairsOf(*run)), b = std::log(run->cost.wall_s);
      n += 1, x += a, y += b, xx += a * a, xy += a * b;
    }
    const double spread = n * xx - x * x;
    g.exponent = spread > 1e-9 ? (n * xy - x * y) / spread : std::nan("");
    out.push_back(g);
  }
  return out;
}

std::string toCsv(const std::vector<GrowthRun>& runs) {
  const std::vector<std::string> names = stageNames(runs);
  std::string csv =
      "mission,source,pairs,jobs,wall_s,cpu_s,wall_s_per_pair,peak_resident_mib,peak_anonymous_mib,peak_all_"
      "mib,result_bytes";
  for (const std::string& name : names) csv += "," + name + "_s";
  csv += "\n";
  for (const GrowthRun& r : runs) {
    csv += r.mission + "," + r.source + "," + std::to_string(r.pairs) + "," + std::to_string(r.jobs) + "," +
           fixedDigits(r.cost.wall_s, 3) + "," + fixedDigits(r.cost.cpu_s, 3) + "," +
           fixedDigits(r.cost.wall_s / pairsOf(r), 5);
    for (const std::uint64_t bytes : {r.cost.peak_resident, r.cost.peak_anonymous, r.cost.peak_all})
      csv += "," + fixedDigits(static_cast<double>(bytes) / kMiB, 1);
    csv += "," + std::to_string(r.result_bytes);
    for (const std::string& name : names) csv += "," + fixedDigits(secondsOf(r, name), 3);
    csv += "\n";
  }
  return csv;
}

std::string toJson(const std::vector<GrowthRun>& runs) {
  Json json;
  json["runs"] = Json::array();
  for (const GrowthRun& r : runs) {
    Json stages = Json::object();
    for (const auto& [name, seconds] : r.stages_s) stages[name] = seconds;
    json["runs"].push_back({{"mission", r.mission},
                            {"source", r.source},
                            {"pairs", r.pairs},
                            {"jobs", r.jobs},
                            {"wall_s", r.cost.wall_s},
                            {"cpu_s", r.cost.cpu_s},
                            {"peak_resident_bytes", r.cost.peak_resident},
                            {"peak_anonymous_bytes", r.cost.peak_anonymous},
                            {"peak_all_bytes", r.cost.peak_all},
                            {"result_bytes", r.result_bytes},
                            {"stages_s", stages}});
  }
  for (const Growth& g : growthOf(runs))
    json["growth"].push_back({{"source", g.source},
                              {"jobs", g.jobs},
                              {"exponent", std::isfinite(g.exponent) ? Json(g.exponent) : Json(nullptr)},
                              {"s_per_pair", g.s_per_pair}});
  return json.dump(2) + "\n";
}

std::string toSvg(const std::vector<GrowthRun>& runs) {
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

}  // namespace fathom::growth
