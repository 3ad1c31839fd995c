#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "realtime/base/numbers/order_statistics.hpp"
#include "realtime/base/text.hpp"
#include "sim/campaign/campaign.hpp"
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

// The undisturbed dives with features and with pictures.
using Undisturbed = std::array<DiveResult, 2>;

std::vector<std::string> failuresOf(const DiveResult& d, const Undisturbed& undisturbed) {
  return failedRequirements(d, undisturbed[d.pictures ? 1 : 0]);
}

// A row for each perturbation: the failed requirements of each level, and the first level that has one.
std::vector<web::Row> levelRows(const std::vector<DiveResult>& dives, const Undisturbed& undisturbed) {
  std::map<std::pair<int, int>, std::vector<const DiveResult*>> cells;
  for (const DiveResult& d : dives)
    if (d.perturbation >= 0) cells[{d.perturbation, d.level}].push_back(&d);
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

// Totals over all dives.
std::vector<std::string> summaryLines(const std::vector<DiveResult>& dives) {
  std::size_t mapped = 0, false_closures = 0;
  std::vector<double> nees;
  double nees_sum = 0, inside = 0;
  for (const DiveResult& d : dives) {
    mapped += d.topside_map && d.onboard_map ? 1 : 0;
    false_closures += d.false_closures;
    if (!std::isfinite(d.nees)) continue;
    nees.push_back(d.nees);
    nees_sum += d.nees;
    inside += d.inside;
  }
  const auto count = static_cast<double>(nees.size());
  return {formatted("%zu of %zu have a map on board and topside", mapped, dives.size()),
          formatted("%zu false closures are kept", false_closures),
          nees.empty()
              ? std::string("no poses with covariances")
              : formatted("NEES of a dive's poses (expected: 6): median %.2f, mean %.2f; %.1f %% of poses "
                          "within their own 95 %%",
                          median(nees), nees_sum / count, 100 * inside / count)};
}

// A row for each dive, those with most failed requirements first.
std::vector<web::Row> diveRows(const std::vector<DiveResult>& dives, const Undisturbed& undisturbed) {
  std::vector<std::pair<const DiveResult*, std::vector<std::string>>> order;
  for (const DiveResult& d : dives) order.emplace_back(&d, failuresOf(d, undisturbed));
  std::stable_sort(order.begin(), order.end(),
                   [](const auto& a, const auto& b) { return a.second.size() > b.second.size(); });
  std::vector<web::Row> rows;
  for (const auto& [d, failures] : order) {
    std::string perturbation = "undisturbed";
    if (d->perturbation >= 0) {
      const Perturbation& p = perturbations()[static_cast<std::size_t>(d->perturbation)];
      perturbation = formatted("%s %g", p.name, p.levels[static_cast<std::size_t>(d->level)]);
    }
    rows.push_back({std::to_string(d->dive), perturbation, joined(failures),
                    millimetres(d->onboard_surface_m), millimetres(d->topside_surface_m),
                    percent(d->onboard_coverage), percent(d->topside_coverage),
                    millimetres(d->onboard_track_m), millimetres(d->topside_track_m),
                    std::isfinite(d->nees) ? decimals(d->nees, 2) : "-", percent(d->inside), d->trouble});
  }
  return rows;
}

}  // namespace

void writeCampaignPage(const std::filesystem::path& file, const std::vector<DiveResult>& dives,
                       std::uint64_t seed) {
  Undisturbed undisturbed;
  for (const DiveResult& d : dives)
    if (d.perturbation < 0) undisturbed[d.pictures ? 1 : 0] = d;
  web::ReportPage page("Campaign",
                       std::to_string(dives.size()) + " simulated dives with one perturbation each");
  page.section("Failed requirements by level");
  page.text(
      "A dive is good while it has a map on board and topside, coverage is at least 0.9 of the undisturbed "
      "dive's, "
      "the surface is within 33 mm topside and 66 mm on board (aligned, rms), a track without pictures is "
      "within 3 "
      "times the undisturbed one's, the NEES of its poses is below 22.5 (one dive's poses share an error: "
      "99.9 % of "
      "chi-square), and no false closure is kept.");
  page.table({"perturbation", "level 1", "level 2", "level 3", "level 4", "fails at"},
             levelRows(dives, undisturbed));
  page.section("All dives");
  page.list(summaryLines(dives));
  page.text("To repeat dive N and keep its mission: fathom-sim campaign --out DIR --seed " +
            std::to_string(seed) + " --only N");
  page.table(
      {"dive", "perturbation", "failed", "surface on board mm", "topside mm", "coverage on board %",
       "topside %", "track on board mm", "topside mm", "NEES", "within 95 % of their own %", "trouble"},
      diveRows(dives, undisturbed));
  page.write(file);
}

}  // namespace fathom::sim
