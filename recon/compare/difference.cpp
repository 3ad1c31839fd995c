#include "recon/compare/difference.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "recon/geometry/order_statistics.hpp"

namespace fathom::compare {
namespace {

constexpr std::array<double, 6> kSlopes = {0, 5, 15, 30, 45, 90};  // [deg]
constexpr std::size_t kSigmaClasses = 4;

double slopeDegrees(const HeightMap& map, double east, double north) {
  const double c = map.cell;
  const double de = (map.at(east + c, north) - map.at(east - c, north)) / (2 * c);
  const double dn = (map.at(east, north + c) - map.at(east, north - c)) / (2 * c);
  return std::atan(std::hypot(de, dn)) * 180.0 / std::numbers::pi;
}

struct Compared {
  double difference, slope, sigma;
};

std::vector<DifferenceClass> bySlope(const std::vector<Compared>& all) {
  std::vector<DifferenceClass> classes;
  for (std::size_t k = 0; k + 1 < kSlopes.size(); ++k) {
    std::vector<double> in;
    for (const Compared& c : all)
      if (c.slope >= kSlopes[k] && c.slope < kSlopes[k + 1]) in.push_back(c.difference);
    if (!in.empty()) classes.push_back({kSlopes[k], kSlopes[k + 1], statisticsOf(std::move(in)), 0});
  }
  return classes;
}

// Quarters of the cells by rising uncertainty.
std::vector<DifferenceClass> bySigma(std::vector<Compared> all) {
  all.erase(std::remove_if(all.begin(), all.end(), [](const Compared& c) { return !(c.sigma > 0); }),
            all.end());
  std::sort(all.begin(), all.end(), [](const Compared& a, const Compared& b) { return a.sigma < b.sigma; });
  std::vector<DifferenceClass> classes;
  if (all.size() < kSigmaClasses) return classes;
  for (std::size_t k = 0; k < kSigmaClasses; ++k) {
    const std::size_t begin = k * all.size() / kSigmaClasses, end = (k + 1) * all.size() / kSigmaClasses;
    std::vector<double> in;
    double ratios = 0;
    for (std::size_t i = begin; i < end; ++i) {
      in.push_back(all[i].difference);
      ratios += std::pow(all[i].difference / all[i].sigma, 2);
    }
    classes.push_back({all[begin].sigma, all[end - 1].sigma, statisticsOf(std::move(in)),
                       std::sqrt(ratios / static_cast<double>(end - begin))});
  }
  return classes;
}

}  // namespace

DifferenceStatistics statisticsOf(std::vector<double> d) {
  DifferenceStatistics s;
  s.cells = d.size();
  if (d.empty()) return s;
  const double n = static_cast<double>(d.size());
  double squares = 0;
  for (const double v : d) {
    s.bias += v / n;
    squares += v * v / n;
  }
  s.rms = std::sqrt(squares);
  s.deviation = std::sqrt(std::max(0.0, squares - s.bias * s.bias));
  std::sort(d.begin(), d.end());
  s.median = quantile(d, 0.5);
  s.p1 = quantile(d, 0.01);
  s.p5 = quantile(d, 0.05);
  s.p25 = quantile(d, 0.25);
  s.p75 = quantile(d, 0.75);
  s.p95 = quantile(d, 0.95);
  s.p99 = quantile(d, 0.99);
  std::vector<double> magnitudes;
  for (const double v : d) magnitudes.push_back(std::abs(v));
  std::sort(magnitudes.begin(), magnitudes.end());
  s.abs_p50 = quantile(magnitudes, 0.5);
  s.abs_p95 = quantile(magnitudes, 0.95);
  for (double& v : d) v = std::abs(v - s.median);
  std::sort(d.begin(), d.end());
  s.mad = kMadToSigma * quantile(d, 0.5);
  return s;
}

Difference differenceOf(const HeightMap& survey, const HeightMap& reference, const Offset& offset) {
  Difference out;
  out.map = survey;
  out.map.sigma.clear();
  out.map.west += offset.shift.x();
  out.map.north += offset.shift.y();
  std::vector<double> before;
  std::vector<Compared> after;
  std::size_t known = 0;
  for (int row = 0; row < survey.rows; ++row) {
    for (int column = 0; column < survey.columns; ++column) {
      const std::size_t at = survey.index(column, row);
      float& shown = out.map.up[at];
      const double up = static_cast<double>(survey.up[at]);
      if (!std::isfinite(up)) continue;
      ++known;
      const double east = survey.eastOf(column), north = survey.northOf(row);
      const double there = reference.at(east, north);
      if (std::isfinite(there)) before.push_back(up - there);
      const double e = east + offset.shift.x(), n = north + offset.shift.y();
      const double difference = up + offset.upAt(east, north) - reference.at(e, n);
      shown = static_cast<float>(difference);
      if (!std::isfinite(difference)) continue;
      after.push_back({difference, slopeDegrees(reference, e, n),
                       survey.sigma.empty() ? 0.0 : static_cast<double>(survey.sigma[at])});
    }
  }
  out.before = statisticsOf(std::move(before));
  std::vector<double> differences;
  for (const Compared& c : after) differences.push_back(c.difference);
  out.after = statisticsOf(std::move(differences));
  out.by_slope = bySlope(after);
  out.by_sigma = bySigma(after);
  out.overlap_m2 = static_cast<double>(out.after.cells) * survey.cell * survey.cell;
  out.survey_m2 = static_cast<double>(known) * survey.cell * survey.cell;
  return out;
}

}  // namespace fathom::compare
