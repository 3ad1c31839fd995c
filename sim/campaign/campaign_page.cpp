#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "realtime/kernel/text.hpp"
#include "recon/geometry/order_statistics.hpp"
#include "sim/campaign/campaign.hpp"
#include "sim/campaign/perturbations.hpp"
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

}  // namespace

void writeCampaignPage(const std::filesystem::path& file, const std::vector<DiveResult>& dives,
                       std::uint64_t seed) {
  DiveResult undisturbed[2];  // with features, with pictures
  for (const DiveResult& d : dives)
    if (d.perturbation < 0) undisturbed[d.pictures ? 1 : 0] = d;
  const auto faults = [&](const DiveResult& d) { return broken(d, undisturbed[d.pictures ? 1 : 0]); };

  web::Report page("Campaign", std::to_string(dives.size()) + " simulated dives, each disturbed in one way");
  // Level by level: what broke in any of its dives.
  std::map<std::pair<int, int>, std::vector<const DiveResult*>> cells;
  for (const DiveResult& d : dives)
    if (d.perturbation >= 0) cells[{d.perturbation, d.level}].push_back(&d);
  std::vector<web::Row> rows;
  std::size_t whole = 0, wrong = 0;
  std::vector<double> nees;
  double inside = 0;
  for (const DiveResult& d : dives) {
    whole += d.topside_map && d.onboard_map ? 1 : 0;
    wrong += d.false_closures;
    if (!std::isfinite(d.nees)) continue;
    nees.push_back(d.nees);
    inside += d.inside;
  }
  for (std::size_t p = 0; p < perturbations().size(); ++p) {
    const Perturbation& what = perturbations()[p];
    web::Row row{std::string(what.name) + " [" + what.unit + "]"};
    std::string threshold = "-";
    for (std::size_t l = 0; l < Perturbation::kLevels; ++l) {
      std::size_t bad = 0;
      std::vector<std::string> reasons;
      const auto& here = cells[{static_cast<int>(p), static_cast<int>(l)}];
      for (const DiveResult* d : here) {
        const auto found = faults(*d);
        bad += found.empty() ? 0 : 1;
        for (const std::string& reason : found)
          if (std::find(reasons.begin(), reasons.end(), reason) == reasons.end()) reasons.push_back(reason);
      }
      const std::string value = formatted("%g", what.levels[l]);
      if (bad > 0 && threshold == "-") threshold = value;
      row.emplace_back(here.empty() ? value + ": not dived"
                       : bad == 0   ? value + ": good"
                                    : value + ": " + joined(reasons),
                       here.empty() ? 0.0 : static_cast<double>(bad) / static_cast<double>(here.size()));
    }
    row.emplace_back(threshold);
    rows.push_back(row);
  }
  page.section("What breaks at which level");
  page.text(
      "A dive is good while it has a map on board and topside, coverage is at least 0.9 of the undisturbed "
      "dive's, "
      "the surface is within 33 mm topside and 66 mm on board (aligned, rms), a track without pictures is "
      "within 3 "
      "times the undisturbed one's, the NEES of its poses is below 22.5 (one dive's poses share an error: "
      "99.9 % of "
      "chi-square), and no false closure stays.");
  page.table({"disturbed by", "level 1", "level 2", "level 3", "level 4", "breaks at"}, rows);
  page.section("All dives");
  page.list({formatted("%zu of %zu have a map on board and topside", whole, dives.size()),
             formatted("%zu false closures stay", wrong),
             nees.empty() ? std::string("no poses with covariances")
                          : formatted("NEES of a dive's poses (6 is honest): median %.2f, mean %.2f; %.1f %% "
                                      "of poses within their own 95 %%",
                                      median(nees),
                                      std::accumulate(nees.begin(), nees.end(), 0.0) /
                                          static_cast<double>(nees.size()),
                                      100 * inside / static_cast<double>(nees.size()))});
  std::vector<std::pair<const DiveResult*, std::vector<std::string>>> order;
  for (const DiveResult& d : dives) order.emplace_back(&d, faults(d));
  std::stable_sort(order.begin(), order.end(),
                   [](const auto& a, const auto& b) { return a.second.size() > b.second.size(); });
  std::vector<web::Row> worst;
  for (const auto& [d, found] : order) {
    std::string what = "undisturbed";
    if (d->perturbation >= 0) {
      const Perturbation& p = perturbations()[static_cast<std::size_t>(d->perturbation)];
      what = formatted("%s %g", p.name, p.levels[static_cast<std::size_t>(d->level)]);
    }
    worst.push_back({std::to_string(d->dive), what, joined(found), millimetres(d->onboard_surface_m),
                     millimetres(d->topside_surface_m), percent(d->onboard_coverage),
                     percent(d->topside_coverage), millimetres(d->onboard_track_m),
                     millimetres(d->topside_track_m), std::isfinite(d->nees) ? decimals(d->nees, 2) : "-",
                     percent(d->inside), d->trouble});
  }
  page.text("Dive N again, to look at: fathom-sim campaign --out DIR --seed " + std::to_string(seed) +
            " --only N");
  page.table(
      {"dive", "disturbed by", "broken", "surface on board mm", "topside mm", "coverage on board %",
       "topside %", "track on board mm", "topside mm", "NEES", "within 95 % of their own %", "trouble"},
      worst);
  page.write(file);
}

}  // namespace fathom::sim
