#include "recon/surface/charts.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <map>
#include <numeric>

#include "recon/geometry/mesh.hpp"
#include "recon/surface/chart_face.hpp"

namespace fathom::surface {
namespace {

constexpr std::uint32_t kNoRegion = 0xFFFFFFFF;
// A slope of up to 60 degrees is drawn from above: there texels are stretched to twice their length.
constexpr double kSeenFromAbove = 0.5;
// Least cosine between a chart's axis and the normals of its faces; less for small charts that join
// a neighbour.
constexpr double kGrown = 0.5, kJoined = 0.25;
// A chart of fewer faces than this costs more in gutters and doubled vertices than it gains.
constexpr std::size_t kFewFaces = 12;
// Slivers from snapping to a lattice may be almost edge-on: up to so many texels of area.
constexpr double kSliverTexels = 200, kSliver = 0.02;

const Eigen::Vector3d kUp(0, 0, -1);

// Texel centres of one chart's rectangle that are taken.
class CoverMask {
 public:
  CoverMask(int width, int height)
      : words_((static_cast<std::size_t>(width) + 63) / 64),
        height_(height),
        bits_(words_ * static_cast<std::size_t>(height), 0) {}

  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] bool any(int row, int first, int last) const {
    bool found = false;
    span(row, first, last, [&](std::size_t word, std::uint64_t mask) { found |= (bits_[word] & mask) != 0; });
    return found;
  }
  void set(int row, int first, int last) {
    span(row, first, last, [&](std::size_t word, std::uint64_t mask) { bits_[word] |= mask; });
  }

 private:
  void span(int row, int first, int last, const auto& visit) const {
    if (first >= last) return;
    const auto a = static_cast<std::size_t>(first), b = static_cast<std::size_t>(last - 1);
    const std::size_t base = static_cast<std::size_t>(row) * words_;
    for (std::size_t w = a / 64; w <= b / 64; ++w) {
      std::uint64_t mask = ~std::uint64_t{0};
      if (w == a / 64) mask &= ~std::uint64_t{0} << (a % 64);
      if (w == b / 64) mask &= ~std::uint64_t{0} >> (63 - b % 64);
      visit(base + w, mask);
    }
  }

  std::size_t words_;
  int height_;
  std::vector<std::uint64_t> bits_;
};

class Charts {
 public:
  Charts(const Mesh& mesh, double texel) : mesh_(mesh), texel_(texel) {
    const std::size_t count = mesh.triangles.size();
    normal_.resize(count);
    area_.resize(count);
    for (std::size_t f = 0; f < count; ++f) {
      const Eigen::Vector3d a = corner(f, 0), n = (corner(f, 1) - a).cross(corner(f, 2) - a);
      area_[f] = n.norm() / 2;
      normal_[f] = area_[f] > 0 ? Eigen::Vector3d(n / (2 * area_[f])) : Eigen::Vector3d(0, 0, 0);
    }
    findNeighbours();
    region_of_.assign(count, kNoRegion);
  }

  std::vector<ChartFaces> run() {
    growFromAbove();
    growSteep();
    joinSmall();
    return separate();
  }

 private:
  struct Region {
    std::vector<std::uint32_t> faces;
    Eigen::Vector3d outwards;
    bool from_above;
    double area = 0;
  };

  [[nodiscard]] Eigen::Vector3d corner(std::size_t face, std::size_t k) const {
    return mesh_.vertices[mesh_.triangles[face][k]].cast<double>();
  }
  // A face without area fits every axis.
  [[nodiscard]] double seen(std::size_t face, const Eigen::Vector3d& outwards) const {
    return area_[face] > 0 ? normal_[face].dot(outwards) : 1;
  }

  void findNeighbours() {
    neighbour_.assign(mesh_.triangles.size(), {kNoRegion, kNoRegion, kNoRegion});
    visitEdges(mesh_.triangles, [&](const std::vector<std::uint32_t>& sides) {
      if (sides.size() != 2) return;
      neighbour_[sides[0] / 3][sides[0] % 3] = sides[1] / 3;
      neighbour_[sides[1] / 3][sides[1] % 3] = sides[0] / 3;
    });
  }

  // Takes `seed` and all free faces that connect to it and pass `accept`.
  void grow(std::uint32_t seed, Region region, const auto& accept) {
    const auto number = static_cast<std::uint32_t>(regions_.size());
    region.faces = {seed};
    region_of_[seed] = number;
    for (std::size_t next = 0; next < region.faces.size(); ++next) {
      region.area += area_[region.faces[next]];
      for (const std::uint32_t n : neighbour_[region.faces[next]])
        if (n != kNoRegion && region_of_[n] == kNoRegion && accept(n)) {
          region_of_[n] = number;
          region.faces.push_back(n);
        }
    }
    regions_.push_back(std::move(region));
  }

  void growFromAbove() {
    const auto fits = [this](std::uint32_t face) { return seen(face, kUp) >= kSeenFromAbove; };
    for (std::uint32_t f = 0; f < mesh_.triangles.size(); ++f)
      if (region_of_[f] == kNoRegion && fits(f)) grow(f, {{}, kUp, true}, fits);
  }

  void growSteep() {
    // The largest face first: its normal is the least noisy.
    std::vector<std::uint32_t> order;
    for (std::uint32_t f = 0; f < mesh_.triangles.size(); ++f)
      if (region_of_[f] == kNoRegion) order.push_back(f);
    std::stable_sort(order.begin(), order.end(),
                     [this](std::uint32_t a, std::uint32_t b) { return area_[a] > area_[b]; });
    for (const std::uint32_t seed : order) {
      if (region_of_[seed] != kNoRegion) continue;
      // First the axis of a seed's surroundings, then all faces that fit it.
      Eigen::Vector3d mean = area_[seed] * normal_[seed];
      std::vector<std::uint32_t> near = {seed};
      constexpr std::size_t kSurroundings = 40;
      for (std::size_t next = 0; next < near.size() && near.size() < kSurroundings; ++next)
        for (const std::uint32_t n : neighbour_[near[next]])
          if (n != kNoRegion && region_of_[n] == kNoRegion && seen(n, normal_[seed]) >= kGrown &&
              std::find(near.begin(), near.end(), n) == near.end()) {
            near.push_back(n);
            mean += area_[n] * normal_[n];
          }
      const Eigen::Vector3d outwards = mean.norm() > 0 ? mean.normalized() : kUp;
      grow(seed, {{}, outwards, false}, [&](std::uint32_t face) { return seen(face, outwards) >= kGrown; });
    }
  }

  void joinSmall() {
    std::vector<std::uint32_t> order(regions_.size());
    std::iota(order.begin(), order.end(), std::uint32_t{0});
    std::stable_sort(order.begin(), order.end(), [this](std::uint32_t a, std::uint32_t b) {
      return regions_[a].faces.size() < regions_[b].faces.size();
    });
    for (const std::uint32_t number : order) {
      Region& small = regions_[number];
      if (small.faces.size() >= kFewFaces) continue;
      std::map<std::uint32_t, double> border;  // length along each neighbour
      for (const std::uint32_t f : small.faces)
        for (std::size_t k = 0; k < 3; ++k) {
          const std::uint32_t n = neighbour_[f][k];
          if (n != kNoRegion && region_of_[n] != number)
            border[region_of_[n]] += (corner(f, (k + 1) % 3) - corner(f, k)).norm();
        }
      std::uint32_t best = kNoRegion;
      for (const auto& [other, length] : border) {
        const Eigen::Vector3d& axis = regions_[other].outwards;
        const double least = small.area <= kSliverTexels * texel_ * texel_ ? kSliver : kJoined;
        const bool fits = std::all_of(small.faces.begin(), small.faces.end(),
                                      [&](std::uint32_t f) { return seen(f, axis) >= least; });
        if (fits && (best == kNoRegion || length > border[best])) best = other;
      }
      if (best == kNoRegion) continue;
      for (const std::uint32_t f : small.faces) region_of_[f] = best;
      Region& large = regions_[best];
      large.faces.insert(large.faces.end(), small.faces.begin(), small.faces.end());
      large.area += small.area;
      small.faces.clear();
    }
  }

  struct Sheet {  // a chart being filled
    ChartFrame frame;
    double left, top;  // of the rectangle [texels]
    CoverMask mask;
  };

  [[nodiscard]] Sheet sheetFor(const std::vector<std::uint32_t>& faces, const ChartFrame& frame) const {
    Eigen::Array2d low = Eigen::Array2d::Constant(std::numeric_limits<double>::max()), high = -low;
    for (const std::uint32_t f : faces)
      for (std::size_t k = 0; k < 3; ++k) {
        const Eigen::Array2d at(corner(f, k).dot(frame.right) / texel_,
                                corner(f, k).dot(frame.down) / texel_);
        low = low.min(at);
        high = high.max(at);
      }
    const Eigen::Array2d from = low.floor(), size = high.ceil() - from;
    return {frame, from.x(), from.y(),
            CoverMask(static_cast<int>(size.x()) + 1, static_cast<int>(size.y()) + 1)};
  }

  void rowsOf(const Sheet& sheet, std::uint32_t face, const auto& visit) const {
    std::array<Eigen::Vector2d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k)
      corners[k] = {corner(face, k).dot(sheet.frame.right) / texel_ - sheet.left,
                    corner(face, k).dot(sheet.frame.down) / texel_ - sheet.top};
    forTriangleRows(corners, mesh_.triangles[face], 0, sheet.mask.height(), visit);
  }
  [[nodiscard]] bool hides(const Sheet& sheet, std::uint32_t face) const {
    bool taken = false;
    rowsOf(sheet, face, [&](int row, int first, int last) { taken |= sheet.mask.any(row, first, last); });
    return taken;
  }
  void cover(Sheet& sheet, std::uint32_t face) const {
    rowsOf(sheet, face, [&](int row, int first, int last) { sheet.mask.set(row, first, last); });
  }

  // Divides a chart into charts without hidden faces: faces that hide others go to a further chart.
  std::vector<ChartFaces> separate() {
    std::vector<Region*> above, others;
    for (Region& region : regions_)
      if (!region.faces.empty()) (region.from_above ? above : others).push_back(&region);
    std::stable_sort(above.begin(), above.end(),
                     [](const Region* a, const Region* b) { return a->area > b->area; });
    std::vector<ChartFaces> charts;
    std::vector<std::uint32_t> rest;
    while (!above.empty()) {
      std::vector<std::uint32_t> all;
      for (const Region* region : above) all.insert(all.end(), region->faces.begin(), region->faces.end());
      Sheet sheet = sheetFor(all, frameOf(kUp));
      ChartFaces chart{{}, kUp};
      std::vector<Region*> left_over;
      for (Region* region : above) {
        // One that hides or is hidden stays whole, unless it hides itself.
        const bool alone = chart.faces.empty();
        if (!alone && std::any_of(region->faces.begin(), region->faces.end(),
                                  [&](std::uint32_t f) { return hides(sheet, f); })) {
          left_over.push_back(region);
          continue;
        }
        fill(sheet, region->faces, chart, rest);
      }
      charts.push_back(std::move(chart));
      above = std::move(left_over);
    }
    for (const Region* region : others) addCharts(region->faces, region->outwards, charts);
    addCharts(std::move(rest), kUp, charts);
    for (ChartFaces& chart : charts) std::sort(chart.faces.begin(), chart.faces.end());
    return charts;
  }

  // Adds charts until they have all faces.
  void addCharts(std::vector<std::uint32_t> faces, const Eigen::Vector3d& outwards,
                 std::vector<ChartFaces>& charts) const {
    while (!faces.empty()) {
      Sheet sheet = sheetFor(faces, frameOf(outwards));
      charts.push_back({{}, outwards});
      std::vector<std::uint32_t> hidden;
      fill(sheet, faces, charts.back(), hidden);
      faces = std::move(hidden);
    }
  }

  // Adds faces to the chart in their order; those that would hide others go to `hidden`.
  void fill(Sheet& sheet, const std::vector<std::uint32_t>& faces, ChartFaces& chart,
            std::vector<std::uint32_t>& hidden) const {
    for (const std::uint32_t f : faces) {
      if (hides(sheet, f)) {
        hidden.push_back(f);
        continue;
      }
      cover(sheet, f);
      chart.faces.push_back(f);
    }
  }

  const Mesh& mesh_;
  double texel_;
  std::vector<Eigen::Vector3d> normal_;
  std::vector<double> area_;
  std::vector<std::array<std::uint32_t, 3>> neighbour_;  // across the side from corner k
  std::vector<std::uint32_t> region_of_;
  std::vector<Region> regions_;
};

}  // namespace

ChartFrame frameOf(const Eigen::Vector3d& outwards) {
  const Eigen::Vector3d north(1, 0, 0);
  // Nearly from above or below there is no up on the surface.
  constexpr double kLevel = 0.99;
  const Eigen::Vector3d up = std::abs(outwards.dot(kUp)) > kLevel ? north : kUp;
  const Eigen::Vector3d down = -(up - outwards * outwards.dot(up)).normalized();
  return {down.cross(-outwards), down};
}

std::vector<ChartFaces> makeCharts(const Mesh& mesh, double texel) {
  if (mesh.triangles.empty()) return {};
  return Charts(mesh, texel).run();
}

}  // namespace fathom::surface
