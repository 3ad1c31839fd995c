#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <map>
#include <numeric>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
#include "sim/campaign/campaign.hpp"
#include "sim/campaign/dose_regression.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::sim {
namespace {

std::string joined(const std::vector<std::string>& words) {
  std::string out;
  for (const std::string& w : words) out += (out.empty() ? "" : ", ") + w;
  return out;
}

std::string millimetres(double metres) {
  return std::isfinite(metres) ? decimals(1000 * metres, 1) : "-";
}
std::string percent(double share) {
  return std::isfinite(share) ? decimals(100 * share, 1) : "-";
}

using Dives = std::vector<DiveResult>;
// Of undisturbed dives by their numbers.
using Undisturbed = std::map<std::size_t, DiveResult>;

const DiveResult& undisturbedBy(const Undisturbed& undisturbed, const DiveResult& d) {
  static const DiveResult kNone;
  const auto found = undisturbed.find(undisturbedOf(d.plan));
  return found == undisturbed.end() ? kNone : found->second;
}

std::vector<std::string> failuresOf(const DiveResult& d, const Undisturbed& undisturbed) {
  return failedRequirements(d, undisturbedBy(undisturbed, d));
}

std::string named(const Perturbation& p, double level) {
  const std::string value = formatted("%s %.4g", p.name, level);
  return p.unit == std::string("1") ? value : value + " " + p.unit;
}

// A row for each perturbation: the failed requirements of each level, and the first level that has one.
std::vector<web::Row> levelRows(const Dives& dives, const Undisturbed& undisturbed) {
  std::map<std::pair<int, int>, std::vector<const DiveResult*>> cells;
  for (const DiveResult& d : dives)
    if (d.plan.perturbation >= 0) cells[{d.plan.perturbation, d.plan.level}].push_back(&d);
  std::vector<web::Row> rows;
  for (std::size_t p = 0; p < perturbations().size(); ++p) {
    const Perturbation& perturbation = perturbations()[p];
    web::Row row{std::string(perturbation.name) + " [" + perturbation.unit + "]"};
    std::string threshold = "-";
    for (std::size_t l = 0; l < Perturbation::kLevels; ++l) {
      std::size_t failed = 0;
      std::vector<std::string> reasons;
      const auto& cell = cells[{static_cast<int>(p), static_cast<int>(l)}];
      for (const DiveResult* d : cell) {
        const auto failures = failuresOf(*d, undisturbed);
        failed += failures.empty() ? 0 : 1;
        for (const std::string& reason : failures)
          if (std::find(reasons.begin(), reasons.end(), reason) == reasons.end()) reasons.push_back(reason);
      }
      const std::string value = formatted("%g", perturbation.levels[l]);
      if (failed > 0 && threshold == "-") threshold = value;
      row.emplace_back(cell.empty()  ? value + ": no dive"
                       : failed == 0 ? value + ": good"
                                     : value + ": " + joined(reasons),
                       cell.empty() ? 0.0 : static_cast<double>(failed) / static_cast<double>(cell.size()));
    }
    row.emplace_back(threshold);
    rows.push_back(row);
  }
  return rows;
}

// Totals over dives.
struct Totals {
  explicit Totals(const Dives& all) : dives(all.size()) {
    for (const DiveResult& d : all) {
      mapped += d.topside_map && d.onboard_map ? 1 : 0;
      false_closures += d.false_closures;
      if (!std::isfinite(d.nees)) continue;
      nees.push_back(d.nees);
      inside += d.inside;
    }
  }
  std::size_t dives, mapped = 0, false_closures = 0;
  std::vector<double> nees;  // of dives with covariances
  double inside = 0;         // of these
};

std::vector<std::string> summaryLines(const Dives& dives) {
  const Totals all(dives);
  const auto count = static_cast<double>(all.nees.size());
  return {formatted("%zu of %zu have a map on board and topside", all.mapped, all.dives),
          formatted("%zu false closures are kept", all.false_closures),
          all.nees.empty()
              ? std::string("no poses with covariances")
              : formatted("NEES of a dive's poses (expected: 6): median %.2f, mean %.2f; %.1f %% of poses "
                          "within their own 95 %%",
                          median(all.nees), std::accumulate(all.nees.begin(), all.nees.end(), 0.0) / count,
                          100 * all.inside / count)};
}

// What disturbs a dive: of a combined one, what is beyond the usual level.
std::string disturbanceOf(const DiveResult& d, std::uint64_t seed) {
  if (d.plan.undisturbed) return "undisturbed";
  if (d.plan.perturbation >= 0) {
    const Perturbation& p = perturbations()[static_cast<std::size_t>(d.plan.perturbation)];
    return named(p, p.levels[static_cast<std::size_t>(d.plan.level)]);
  }
  const std::vector<double> doses = dosesOf(d.plan, seed);
  std::vector<std::string> beyond;
  for (std::size_t p = 0; p < doses.size(); ++p)
    if (doses[p] > 1) beyond.push_back(named(perturbations()[p], perturbations()[p].levelOf(doses[p])));
  return joined(beyond);
}

// A row for each dive, those with most failed requirements first.
std::vector<web::Row> diveRows(const Dives& dives, const Undisturbed& undisturbed, std::uint64_t seed) {
  std::vector<std::pair<const DiveResult*, std::vector<std::string>>> order;
  for (const DiveResult& d : dives) order.emplace_back(&d, failuresOf(d, undisturbed));
  std::stable_sort(order.begin(), order.end(),
                   [](const auto& a, const auto& b) { return a.second.size() > b.second.size(); });
  const auto number = [](double v, int digits) { return std::isfinite(v) ? decimals(v, digits) : "-"; };
  std::vector<web::Row> rows;
  for (const auto& [d, failures] : order)
    rows.push_back({std::to_string(d->plan.dive), disturbanceOf(*d, seed), joined(failures),
                    millimetres(d->onboard_surface_m), millimetres(d->topside_surface_m),
                    percent(d->onboard_coverage), percent(d->topside_coverage),
                    millimetres(d->onboard_track_m), millimetres(d->topside_track_m),
                    number(d->colour_median, 1), number(d->colour_p95, 1), number(d->nees, 2),
                    percent(d->inside), d->trouble});
  return rows;
}

// Sorted, without what was not measured.
template <typename Value>
std::vector<double> measured(const Dives& dives, const Value& value) {
  std::vector<double> out;
  for (const DiveResult& d : dives)
    if (const double v = value(d); std::isfinite(v)) out.push_back(v);
  std::sort(out.begin(), out.end());
  return out;
}

// Disturbed dives of all perturbations against the goals.
std::vector<web::Row> goalRows(const Dives& dives, const Undisturbed& undisturbed) {
  const Totals all(dives);
  const auto consistent =
      std::count_if(all.nees.begin(), all.nees.end(), [](double nees) { return nees <= kWorstNees; });
  const auto quantiles = [&](const auto& value, std::initializer_list<double> shares, double times,
                             int digits) {
    const std::vector<double> sorted = measured(dives, value);
    std::vector<std::string> out;
    for (const double share : shares)
      out.push_back(sorted.empty() ? "-" : decimals(times * quantile(sorted, share), digits));
    return joined(out);
  };
  constexpr double kMedian = 0.5, kMost = 0.95, kMm = 1000;
  const auto coverage = [&](auto member) {
    return quantiles([&](const DiveResult& d) { return d.*member / undisturbedBy(undisturbed, d).*member; },
                     {1 - kMost}, 1, 2);
  };
  const Requirements wanted = requirementsOf(DiveSeries::kTune);
  const std::vector<double> claims =
      measured(dives, [](const DiveResult& d) { return d.topside_surface_squares; });
  return {
      {"map on board and topside", "all", formatted("%zu of %zu", all.mapped, all.dives)},
      {"false closures kept", 0, all.false_closures},
      {"surface topside, aligned: median, 95 % [mm]", formatted("8, %g", kMm * wanted.surface_m),
       quantiles([](const DiveResult& d) { return d.topside_surface_m; }, {kMedian, kMost}, kMm, 1)},
      {"surface on board, aligned: median, 95 % [mm]", formatted("-, %g", kMm * wanted.onboard_m),
       quantiles([](const DiveResult& d) { return d.onboard_surface_m; }, {kMedian, kMost}, kMm, 1)},
      {"coverage over the undisturbed dive's: topside, on board; 5 % are below",
       formatted("%g, %g", wanted.coverage, wanted.coverage),
       coverage(&DiveResult::topside_coverage) + ", " + coverage(&DiveResult::onboard_coverage)},
      {"colours of a dive, CIEDE2000: median of medians, median of their 95 %",
       formatted("3, %g", wanted.colour_p95),
       quantiles([](const DiveResult& d) { return d.colour_median; }, {kMedian}, 1, 1) + ", " +
           quantiles([](const DiveResult& d) { return d.colour_p95; }, {kMedian}, 1, 1)},
      {"surface topside, rms of error in nav over claimed sigma: all, median", "0.77 to 1.3",
       claims.empty() ? std::string("-")
                      : decimals(std::sqrt(std::accumulate(claims.begin(), claims.end(), 0.0) /
                                           static_cast<double>(claims.size())),
                                 2) +
                            ", " + decimals(std::sqrt(median(claims)), 2)},
      {"NEES of poses within 99.9 % of chi-square", "all",
       formatted("%td of %zu", consistent, all.nees.size())},
  };
}

// Results whose dependence on the doses is sought.
struct Cost {
  const char* head;
  bool relative;  // to the undisturbed dive, as a ratio
  double DiveResult::*result;
  double times;  // its unit in `head`
  int digits;
  double worse = 1;  // side that is worse
};
constexpr double kPercent = 100;
constexpr Cost kCosts[] = {
    {"surface topside %", true, &DiveResult::topside_surface_m, kPercent, 0},
    {"surface on board %", true, &DiveResult::onboard_surface_m, kPercent, 0},
    {"coverage topside points", false, &DiveResult::topside_coverage, kPercent, 1, -1},
    {"coverage on board points", false, &DiveResult::onboard_coverage, kPercent, 1, -1},
    {"NEES %", true, &DiveResult::nees, kPercent, 0},
    {"colours CIEDE2000", false, &DiveResult::colour_median, 1, 2}};

// A dive's result over its undisturbed dive's: logarithm of the ratio, or difference.
double costOf(const Cost& cost, const DiveResult& d, const DiveResult& undisturbed) {
  const double value = d.*cost.result, calm = undisturbed.*cost.result;
  return cost.relative ? std::log(value / calm) : value - calm;
}

double shown(const Cost& cost, double effect) {
  return cost.times * (cost.relative ? std::expm1(effect) : effect);
}

DoseEffects effectsOn(const Cost& cost, const Dives& dives, const Undisturbed& undisturbed,
                      std::uint64_t seed) {
  std::vector<double> results, doses;
  for (const DiveResult& d : dives) {
    const double result = costOf(cost, d, undisturbedBy(undisturbed, d));
    if (!std::isfinite(result)) continue;
    results.push_back(result);
    const std::vector<double> own = dosesOf(d.plan, seed);
    doses.insert(doses.end(), own.begin(), own.end());
  }
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto rows = static_cast<Eigen::Index>(results.size()),
             columns = static_cast<Eigen::Index>(perturbations().size());
  return regressDoses(Eigen::Map<const RowMajor>(doses.data(), rows, columns),
                      Eigen::Map<const Eigen::VectorXd>(results.data(), rows));
}

void addCosts(web::ReportPage& page, const Dives& dives, const Undisturbed& undisturbed, std::uint64_t seed) {
  constexpr double kSure = 3;  // standard deviations
  std::vector<DoseEffects> effects;
  web::Row head{"perturbation at its usual level"};
  for (const Cost& cost : kCosts) {
    effects.push_back(effectsOn(cost, dives, undisturbed, seed));
    head.emplace_back(cost.head);
  }
  std::vector<web::Row> rows, pairs;
  for (std::size_t p = 0; p < perturbations().size(); ++p) {
    web::Row row{named(perturbations()[p], perturbations()[p].usual)};
    for (std::size_t c = 0; c < effects.size(); ++c) {
      const auto i = static_cast<Eigen::Index>(p);
      if (effects[c].effect.size() == 0) {
        row.emplace_back("-");
        continue;
      }
      const double effect = effects[c].effect[i], sigmas = effect / effects[c].sigma[i];
      row.emplace_back(
          web::plusMinus(shown(kCosts[c], effect), std::abs(shown(kCosts[c], effects[c].sigma[i])),
                         kCosts[c].digits),
          std::abs(sigmas) < kSure ? 0.0 : kCosts[c].worse * std::clamp(sigmas / (3 * kSure), -1.0, 1.0));
    }
    rows.push_back(row);
  }
  for (std::size_t c = 0; c < effects.size(); ++c)
    for (const PairEffect& pair : effects[c].pairs)
      pairs.push_back({perturbations()[pair.a].name, perturbations()[pair.b].name, kCosts[c].head,
                       decimals(shown(kCosts[c], pair.effect), kCosts[c].digits)});
  page.section("What each perturbation costs");
  page.text(
      "By regression over all dives: what a perturbation at its usual level (which nine of ten dives stay "
      "below) adds to a result, against the undisturbed dive of the same site. Coloured: beyond three "
      "standard deviations.");
  page.table(head, rows);
  page.section("Worse together than apart");
  if (pairs.empty())
    page.text("No pair of perturbations, beyond chance.");
  else
    page.table({"perturbation", "and", "result", "adds, both at their usual level, to the sum of both"},
               pairs);
}

std::string requirementText(DiveSeries series) {
  constexpr double kMm = 1000;
  const Requirements wanted = requirementsOf(series);
  const std::string colours = std::isfinite(wanted.colour_p95)
                                  ? formatted("95 %% of colours are within %g, ", wanted.colour_p95)
                                  : "a track without pictures is within 3 times the undisturbed one's, ";
  return formatted(
             "A dive is good while it has a map on board and topside, coverage is at least %g of the "
             "undisturbed dive's, the surface is within %g mm topside and %g mm on board (aligned, rms), ",
             wanted.coverage, kMm * wanted.surface_m, kMm * wanted.onboard_m) +
         colours +
         formatted(
             "the NEES of its poses is below %.1f (one dive's poses share an error: 99.9 %% of "
             "chi-square), and no false closure is kept.",
             kWorstNees);
}

// Share of dives below each value.
web::Series cumulative(const std::string& label, const char* colour, const std::vector<double>& sorted) {
  web::Series line{.label = label, .colour = colour};
  for (std::size_t k = 0; k < sorted.size(); ++k)
    line.at.emplace_back(1000 * sorted[k],
                         100 * static_cast<double>(k + 1) / static_cast<double>(sorted.size()));
  return line;
}

void addCombined(web::ReportPage& page, const Dives& all, const Undisturbed& undisturbed,
                 std::uint64_t seed) {
  Dives dives;
  for (const DiveResult& d : all)
    if (!d.plan.undisturbed) dives.push_back(d);
  page.section("Goals");
  page.text(requirementText(DiveSeries::kTune));
  page.table({"", "goal", "reached"}, goalRows(dives, undisturbed));
  page.plot({.title = "Dives whose surface is within",
             .x = "surface, aligned rms [mm]",
             .y = "dives [%]",
             .series = {cumulative("topside", web::kBlue,
                                   measured(dives, [](const DiveResult& d) { return d.topside_surface_m; })),
                        cumulative("on board", web::kRed,
                                   measured(dives, [](const DiveResult& d) { return d.onboard_surface_m; }))},
             .log_x = true});
  addCosts(page, dives, undisturbed, seed);
}

void addSingle(web::ReportPage& page, const Dives& dives, const Undisturbed& undisturbed) {
  page.section("Failed requirements by level");
  page.text(requirementText(DiveSeries::kSingle));
  page.table({"perturbation", "level 1", "level 2", "level 3", "level 4", "fails at"},
             levelRows(dives, undisturbed));
}

}  // namespace

void writeCampaignPage(const CampaignOptions& options, const std::vector<DiveResult>& dives) {
  const bool single = options.series == DiveSeries::kSingle;
  Undisturbed undisturbed;
  for (const DiveResult& d : dives)
    if (d.plan.undisturbed) undisturbed[d.plan.dive] = d;
  web::ReportPage page("Campaign",
                       formatted("%zu simulated dives with %s", dives.size(),
                                 single ? "one perturbation each" : "all perturbations together"));
  if (single)
    addSingle(page, dives, undisturbed);
  else
    addCombined(page, dives, undisturbed, options.seed);
  page.section("All dives");
  page.list(summaryLines(dives));
  page.text(formatted(
      "To repeat dive N and keep its mission: fathom-sim campaign --out DIR --series %s --seed %llu "
      "--only N",
      nameOf(options.series), static_cast<unsigned long long>(options.seed)));
  page.table({"dive", single ? "perturbation" : "beyond the usual level", "failed", "surface on board mm",
              "topside mm", "coverage on board %", "topside %", "track on board mm", "topside mm",
              "colours: median", "95 %", "NEES", "within 95 % of their own %", "trouble"},
             diveRows(dives, undisturbed, options.seed));
  page.write(options.out / "campaign.html");
}

}  // namespace fathom::sim
