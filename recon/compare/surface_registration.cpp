#include "recon/compare/surface_registration.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "realtime/base/numbers/order_statistics.hpp"
#include "recon/geometry/uncertain_pose.hpp"

namespace fathom::compare {
namespace {

constexpr double kMinCorrelation = 0.5;  // less: the offset explains not even a quarter of the relief
constexpr double kMaxSigmaCells = 0.5;   // of a horizontal direction that counts as resolved
constexpr std::size_t kMinCells = 30;    // least for a registration
constexpr double kInfinity = std::numeric_limits<double>::infinity();

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;
// Of at most five unknowns: without heap, and without the code of large products.
using Basis = Eigen::Matrix<double, 5, Eigen::Dynamic, Eigen::ColMajor, 5, 5>;
using Reduced = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, 5, 5>;

// One cell of the survey at the offset of the present iteration.
struct Cell {
  double east, north, survey, reference;
  Eigen::Vector2d survey_gradient, reference_gradient;
  int block;
};

Eigen::Vector2d gradient(const HeightMap& map, double east, double north) {
  const double c = map.cell;
  return {(map.at(east + c, north) - map.at(east - c, north)) / (2 * c),
          (map.at(east, north + c) - map.at(east, north - c)) / (2 * c)};
}

// Most cells that are used, evenly selected: enough for any offset.
constexpr std::size_t kMostCellsMatched = 400'000;
constexpr int kBlocks = 10;  // along the longer side

std::vector<Cell> commonCells(const HeightMap& survey, const HeightMap& reference,
                              const Eigen::Vector2d& shift) {
  const int step = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(survey.up.size()) /
                                                          static_cast<double>(kMostCellsMatched))));
  const int block = std::max(1, std::max(survey.columns, survey.rows) / kBlocks);
  std::vector<Cell> cells;
  for (int row = 0; row < survey.rows; row += step) {
    for (int column = 0; column < survey.columns; column += step) {
      const float up = survey.up[survey.index(column, row)];
      if (!std::isfinite(up)) continue;
      const double east = survey.eastOf(column), north = survey.northOf(row);
      Cell cell{east,
                north,
                static_cast<double>(up),
                reference.at(east + shift.x(), north + shift.y()),
                gradient(survey, east, north),
                gradient(reference, east + shift.x(), north + shift.y()),
                (row / block) * (kBlocks + 2) + column / block};
      if (std::isfinite(cell.reference) && cell.survey_gradient.allFinite() &&
          cell.reference_gradient.allFinite())
        cells.push_back(cell);
    }
  }
  return cells;
}

// Median absolute deviation of the heights' differences after a shift of whole cells; infinite where too
// little is common.
double mismatch(const HeightMap& survey, const HeightMap& reference, int east_cells, int north_cells,
                std::size_t at_least, std::size_t& common) {
  const int dx = static_cast<int>(std::lround((survey.west - reference.west) / survey.cell)) + east_cells;
  const int dy = static_cast<int>(std::lround((reference.north - survey.north) / survey.cell)) - north_cells;
  std::vector<double> differences;
  for (int row = 0; row < survey.rows; ++row) {
    if (row + dy < 0 || row + dy >= reference.rows) continue;
    for (int column = 0; column < survey.columns; ++column) {
      if (column + dx < 0 || column + dx >= reference.columns) continue;
      const float a = survey.up[survey.index(column, row)];
      const float b = reference.up[reference.index(column + dx, row + dy)];
      if (std::isfinite(a) && std::isfinite(b)) differences.push_back(static_cast<double>(a - b));
    }
  }
  common = differences.size();
  if (common < std::max(at_least, kMinCells)) return kInfinity;
  const double middle = median(std::span(differences));
  for (double& d : differences) d = std::abs(d - middle);
  return median(std::move(differences));
}

// The best shift of whole coarse cells within `reach` of `start`, both in cells.
Eigen::Vector2i bestShift(const HeightMap& survey, const HeightMap& reference, const Eigen::Vector2i& start,
                          int reach) {
  const int side = 2 * reach + 1;
  std::vector<double> cost(static_cast<std::size_t>(side * side), kInfinity);
  std::vector<std::size_t> common(cost.size(), 0);
  tbb::parallel_for(0, side * side, [&](int i) {
    const auto at = static_cast<std::size_t>(i);
    cost[at] = mismatch(survey, reference, start.x() + i % side - reach, start.y() + i / side - reach, 0,
                        common[at]);
  });
  // A shift that leaves little in common finds an easy agreement.
  const std::size_t most = *std::max_element(common.begin(), common.end());
  Eigen::Vector2i best = start;
  double lowest = kInfinity;
  for (int i = 0; i < side * side; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (2 * common[at] < most || !(cost[at] < lowest)) continue;
    lowest = cost[at];
    best = start + Eigen::Vector2i(i % side - reach, i / side - reach);
  }
  return best;
}

// Coarse to fine, to whole cells of the maps [m].
Eigen::Vector2d searchShift(const HeightMap& survey, const HeightMap& reference, double max_shift) {
  constexpr int kReach = 16;  // cells to either side at the coarsest step
  int factor = 1;
  while (max_shift / (survey.cell * factor) > kReach) factor *= 2;
  // The coarse cells of both must be on one lattice: the reference is cropped to the survey's.
  const auto aligned = [&](int by) {
    HeightMap cropped = reference;
    const auto behind = [by](double cells) { return ((std::llround(cells) % by) + by) % by; };
    const int skip_columns = static_cast<int>(behind((survey.west - reference.west) / survey.cell));
    const int skip_rows = static_cast<int>(behind((reference.north - survey.north) / survey.cell));
    cropped.columns = reference.columns - skip_columns;
    cropped.rows = reference.rows - skip_rows;
    cropped.west += skip_columns * survey.cell;
    cropped.north -= skip_rows * survey.cell;
    cropped.up.clear();
    for (int row = 0; row < cropped.rows; ++row)
      for (int column = 0; column < cropped.columns; ++column)
        cropped.up.push_back(reference.up[reference.index(column + skip_columns, row + skip_rows)]);
    cropped.sigma.clear();
    return cropped.coarser(by);
  };
  Eigen::Vector2i shift = Eigen::Vector2i::Zero();
  bool first = true;
  for (; factor >= 1; factor /= 2) {
    const int reach = first ? static_cast<int>(std::ceil(max_shift / (survey.cell * factor))) : 2;
    if (!first) shift *= 2;
    shift = bestShift(survey.coarser(factor), aligned(factor), shift, reach);
    first = false;
    // Below this many cells finer steps cost time, and the next stage finds the rest.
    constexpr std::size_t kFine = 250'000;
    if (factor > 1 && survey.up.size() / static_cast<std::size_t>(factor * factor / 4) > 4 * kFine) break;
  }
  return shift.cast<double>() * survey.cell * std::max(factor, 1);
}

double tukey(double residual, double scale) {
  constexpr double kReach = 4.685;  // 95 % efficient for normal errors
  const double u = residual / (kReach * scale);
  return std::abs(u) < 1 ? (1 - u * u) * (1 - u * u) : 0.0;
}

// Least squares plane taken away from heights at places (about the centre).
void removePlane(const std::vector<Cell>& cells, const Eigen::Vector2d& centre, Eigen::VectorXd& heights) {
  Eigen::MatrixXd a(static_cast<Eigen::Index>(cells.size()), 3);
  for (std::size_t i = 0; i < cells.size(); ++i)
    a.row(static_cast<Eigen::Index>(i)) << 1, cells[i].east - centre.x(), cells[i].north - centre.y();
  const Eigen::Vector3d plane = (a.transpose() * a).ldlt().solve(a.transpose() * heights);
  heights -= a * plane;
}

void describeTerrain(const std::vector<Cell>& cells, const Eigen::Vector2d& centre,
                     SurfaceRegistration& out) {
  const auto n = static_cast<Eigen::Index>(cells.size());
  Eigen::VectorXd a(n), b(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    a[i] = cells[static_cast<std::size_t>(i)].survey;
    b[i] = cells[static_cast<std::size_t>(i)].reference;
  }
  removePlane(cells, centre, a);
  removePlane(cells, centre, b);
  out.relief = std::sqrt(a.squaredNorm() / static_cast<double>(n));
  const double norms = a.norm() * b.norm();
  out.correlation = norms > 0 ? a.dot(b) / norms : 0;
}

// One system: parameters d east, d north, u, t east, t north.
struct System {
  Matrix5d information = Matrix5d::Zero();  // scores' derivative
  Vector5d score = Vector5d::Zero();
  Matrix5d scatter = Matrix5d::Zero();  // of the scores of blocks
};

System assemble(const std::vector<Cell>& cells, const RegistrationOffset& offset) {
  std::vector<double> residuals;
  for (const Cell& c : cells) residuals.push_back(c.reference - c.survey - offset.upAt(c.east, c.north));
  const double scale = std::max(madSigma(residuals, 0), 1e-6);
  System system;
  std::vector<Vector5d> block_scores(static_cast<std::size_t>((kBlocks + 2) * (kBlocks + 2)),
                                     Vector5d::Zero());
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const Cell& c = cells[i];
    const double w = tukey(residuals[i], scale);
    if (w == 0) continue;
    const Eigen::Vector2d from = Eigen::Vector2d(c.east, c.north) - offset.centre;
    // dr/dp = (gradient of the reference, -1, -from); the instrument has the survey's gradient instead.
    Vector5d slope, instrument;
    slope << c.reference_gradient, -1, -from;
    instrument << c.survey_gradient, -1, -from;
    system.information += w * instrument * slope.transpose();
    const Vector5d score = w * residuals[i] * instrument;
    system.score += score;
    block_scores[static_cast<std::size_t>(c.block)] += score;
  }
  int used = 0;
  for (const Vector5d& s : block_scores) {
    if (s.isZero(0)) continue;
    system.scatter += s * s.transpose();
    ++used;
  }
  if (used > 1) system.scatter *= static_cast<double>(used) / (used - 1);
  return system;
}

// The parameters that are estimated, as columns of a basis.
Basis basisOf(const Eigen::MatrixXd& horizontal, bool tilt) {
  const Eigen::Index n = horizontal.cols();
  Basis basis = Basis::Zero(5, n + 1 + (tilt ? 2 : 0));
  basis.topLeftCorner(2, n) = horizontal;
  basis(2, n) = 1;
  if (tilt) basis.bottomRightCorner(2, 2).setIdentity();
  return basis;
}

struct Solution {
  Vector5d step = Vector5d::Zero();
  Matrix5d covariance = Matrix5d::Zero();
};

Solution solve(const System& system, const Basis& basis) {
  const Reduced reduced = basis.transpose() * system.information * basis;
  const Reduced inverse = reduced.inverse();
  Solution s;
  s.step = -basis * inverse * (basis.transpose() * system.score);
  s.covariance = basis * inverse * (basis.transpose() * system.scatter * basis) * inverse.transpose() *
                 basis.transpose();
  return s;
}

// Newton's steps from `out.offset` in the directions of `horizontal`; false when they lead nowhere.
bool refine(const HeightMap& survey, const HeightMap& reference, const Eigen::MatrixXd& horizontal, bool tilt,
            SurfaceRegistration& out, Matrix5d& covariance) {
  constexpr int kIterations = 40;
  constexpr double kConverged = 1e-4;  // of a cell
  const Basis basis = basisOf(horizontal, tilt);
  const Eigen::Vector2d start = out.offset.shift.head<2>();
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const std::vector<Cell> cells = commonCells(survey, reference, out.offset.shift.head<2>());
    out.cells = cells.size();
    if (cells.size() < kMinCells) return false;
    if (iteration == 0) {
      std::vector<double> differences;
      for (const Cell& c : cells) differences.push_back(c.reference - c.survey);
      out.offset.shift.z() = median(std::move(differences));
    }
    const Solution s = solve(assemble(cells, out.offset), basis);
    if (!s.step.allFinite()) return false;
    covariance = s.covariance;
    // At most two cells in a step: the gradient is valid nearby alone.
    const double far = s.step.head<2>().norm() / (2 * survey.cell);
    const Vector5d step = far > 1 ? Vector5d(s.step / far) : s.step;
    out.offset.shift += step.head<3>();
    out.offset.tilt += step.tail<2>();
    // The search found the valley: a step out of it follows noise.
    if ((out.offset.shift.head<2>() - start).norm() > 4 * survey.cell) return false;
    if (step.head<3>().norm() < kConverged * survey.cell) break;
  }
  return true;
}

}  // namespace

SurfaceRegistration registerMaps(const HeightMap& survey, const HeightMap& reference,
                                 const SurfaceRegistrationConfig& config) {
  SurfaceRegistration out;
  const Box box = survey.box();
  out.offset.centre = {0.5 * (box.west + box.east), 0.5 * (box.south + box.north)};
  out.sigma.setConstant(kInfinity);
  Matrix5d covariance = Matrix5d::Zero();

  Eigen::MatrixXd resolved(2, 0);
  if (config.horizontal) {
    const Eigen::Vector2d found = searchShift(survey, reference, config.max_shift);
    out.offset.shift.head<2>() = found;
    SurfaceRegistration trial = out;
    bool sound = refine(survey, reference, Eigen::Matrix2d::Identity(), config.tilt, trial, covariance);
    const std::vector<Cell> cells = commonCells(survey, reference, trial.offset.shift.head<2>());
    if (cells.size() >= kMinCells) describeTerrain(cells, out.offset.centre, trial);
    const double limit = kMaxSigmaCells * survey.cell;
    if (cells.size() >= kMinCells && trial.correlation >= kMinCorrelation) {
      const Eigen::Matrix2d h = covariance.topLeftCorner<2, 2>();
      const SymmetricEigen<2> eigen = symmetricEigen(Eigen::Matrix2d(0.5 * (h + h.transpose())));
      for (int k = 0; k < 2; ++k) {
        const double variance = eigen.values[k];
        if (!(variance >= 0 && std::sqrt(variance) <= limit)) continue;
        resolved.conservativeResize(2, resolved.cols() + 1);
        resolved.col(resolved.cols() - 1) = eigen.vectors.col(k);
      }
      // A step out of the valley along an unresolved direction does not discredit the other.
      if (!sound && resolved.cols() == 2) resolved.resize(2, 0);
    }
    out.correlation = trial.correlation;
    out.relief = trial.relief;
    if (resolved.cols() == 2) {
      out = trial;
    } else {
      out.offset.shift.setZero();
      if (resolved.cols() == 1) {
        const Eigen::Vector2d along = resolved.col(0);
        out.offset.shift.head<2>() = along * along.dot(trial.offset.shift.head<2>());
      }
    }
  }
  if (resolved.cols() < 2) {
    if (!refine(survey, reference, resolved, config.tilt, out, covariance) && resolved.cols() == 1) {
      resolved.resize(2, 0);
      out.offset.shift.setZero();
      refine(survey, reference, resolved, config.tilt, out, covariance);
    }
  }
  out.directions_resolved = static_cast<int>(resolved.cols());
  if (out.cells < kMinCells) {
    out.cells = 0;
    return out;
  }
  const std::vector<Cell> cells = commonCells(survey, reference, out.offset.shift.head<2>());
  if (cells.size() >= kMinCells) describeTerrain(cells, out.offset.centre, out);
  out.sigma.z() = std::sqrt(std::max(0.0, covariance(2, 2)));
  out.tilt_sigma = covariance.diagonal().tail<2>().cwiseMax(0).cwiseSqrt();
  if (out.directions_resolved == 2) {
    out.covariance = covariance.topLeftCorner<2, 2>();
    out.sigma.head<2>() = out.covariance.diagonal().cwiseMax(0).cwiseSqrt();
    out.at_limit = out.offset.shift.head<2>().cwiseAbs().maxCoeff() > config.max_shift - survey.cell;
    if (out.at_limit) out.note = "the shift is at the search's limit: search further with --max-shift";
  } else if (out.directions_resolved == 1) {
    const Eigen::Vector2d open(-resolved(1, 0), resolved(0, 0));
    out.open_bearing = std::atan2(open.x(), open.y());
    if (out.open_bearing < 0) out.open_bearing += std::numbers::pi;
    out.covariance = covariance.topLeftCorner<2, 2>();
    out.note = "the terrain does not resolve the offset along one bearing; it is held at zero there";
  } else if (config.horizontal) {
    out.note = "the terrain is too flat, or the two are too different, to resolve a horizontal offset";
  }
  return out;
}

}  // namespace fathom::compare
