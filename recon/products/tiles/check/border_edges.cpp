#include "recon/products/tiles/check/border_edges.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <iterator>

namespace fathom::topside {
namespace {

BorderEdge turned(const BorderEdge& edge) {
  return {edge.to, edge.from};
}

std::int32_t steps(float metres) {
  return static_cast<std::int32_t>(std::lround(static_cast<double>(metres) / TileGrid::kLattice));
}

std::vector<BorderEdge> without(const std::vector<BorderEdge>& all, const std::vector<BorderEdge>& those) {
  std::vector<BorderEdge> rest;
  std::set_difference(all.begin(), all.end(), those.begin(), those.end(), std::back_inserter(rest));
  return rest;
}

// Where two cells meet along an edge only, fusion makes a vertex twice, a step apart; surfaces that end there
// on both sides of a plane overlap by that much and do not belong together.
constexpr double kTouch = 2;  // [steps]

// Whether edges of tiles on both sides of a plane, one of them turned round, are meant to be one line: they
// run over a common stretch as seen along `a`, less than `near` steps apart. Stretches are measured along the
// edge and not along the side, for on a steep surface all of a hole's outline stands over a few steps of the
// side.
bool beside(const BorderEdge& a, const BorderEdge& b, std::int64_t near) {
  if (a == turned(b)) return true;  // the same edge by a face of the opposite orientation
  const auto from = [&](const std::array<std::int32_t, 2>& place) {
    return Eigen::Vector2d(place[0] - a.from[0], place[1] - a.from[1]);
  };
  const double length = from(a.to).norm();
  const Eigen::Vector2d along = from(a.to) / length, across(-along.y(), along.x());
  const Eigen::Vector2d first = from(b.from), last = from(b.to);
  const double s0 = first.dot(along), s1 = last.dot(along);
  const double begin = std::max(s0, 0.0), end = std::min(s1, length);
  if (begin + kTouch >= end) return false;
  const auto distance = [&](double s) {
    return std::lerp(first.dot(across), last.dot(across), (s - s0) / (s1 - s0));
  };
  const double d0 = distance(begin), d1 = distance(end);
  return d0 * d1 <= 0 || std::min(std::abs(d0), std::abs(d1)) < static_cast<double>(near);
}

}  // namespace

TileBorders bordersOf(const TileMesh& tile) {
  TileBorders borders;
  const auto& vertices = tile.mesh.vertices;
  for (std::size_t side = 0; side < borders.size(); ++side) {
    const auto bit = static_cast<std::uint8_t>(1U << side);
    const Eigen::Index along = side < 2 ? 1 : 0;
    std::vector<BorderEdge> edges;
    for (const auto& triangle : tile.mesh.triangles)
      for (std::size_t c = 0; c < 3; ++c) {
        const std::uint32_t a = triangle[c], b = triangle[(c + 1) % 3];
        if ((tile.shared[a] & tile.shared[b] & bit) == 0) continue;
        const BorderEdge edge{{steps(vertices[a][along]), steps(vertices[a].z())},
                              {steps(vertices[b][along]), steps(vertices[b].z())}};
        if (edge.from != edge.to) edges.push_back(edge);
      }
    std::sort(edges.begin(), edges.end());
    // An edge that is there reversed, too, has the surface on both its sides.
    std::vector<BorderEdge> back(edges);
    for (BorderEdge& edge : back) edge = turned(edge);
    std::sort(back.begin(), back.end());
    borders[side] = without(edges, back);
  }
  return borders;
}

BorderMatch matchNeighbours(const std::vector<BorderEdge>& here, const std::vector<BorderEdge>& there,
                            double voxel) {
  std::vector<BorderEdge> back(there);
  for (BorderEdge& edge : back) edge = turned(edge);
  std::sort(back.begin(), back.end());
  const std::vector<BorderEdge> mine = without(here, back), yours = without(back, here);
  BorderMatch match;
  match.equal = here.size() - mine.size();
  const auto near = static_cast<std::int64_t>(std::lround(2 * voxel / TileGrid::kLattice));
  for (const BorderEdge& edge : mine) {
    const bool crack = std::any_of(yours.begin(), yours.end(),
                                   [&](const BorderEdge& other) { return beside(edge, other, near); });
    if (crack && match.cracks == 0) match.place = edge.from;
    ++(crack ? match.cracks : match.open);
  }
  for (const BorderEdge& edge : yours)
    if (std::none_of(mine.begin(), mine.end(),
                     [&](const BorderEdge& other) { return beside(edge, other, near); }))
      ++match.open;
  return match;
}

BorderMatch matchLevels(const std::vector<BorderEdge>& parent, std::vector<BorderEdge> children) {
  std::sort(children.begin(), children.end());
  const std::vector<BorderEdge> lost = without(children, parent), invented = without(parent, children);
  BorderMatch match;
  match.equal = parent.size() - invented.size();
  match.cracks = lost.size() + invented.size();
  if (!lost.empty()) match.place = lost.front().from;
  if (lost.empty() && !invented.empty()) match.place = invented.front().from;
  return match;
}

}  // namespace fathom::topside
