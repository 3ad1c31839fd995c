#include "recon/fusion/space_division.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace fathom::fusion {
namespace {

using Closures = std::vector<std::pair<std::uint32_t, std::uint32_t>>;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

MeshFootprint around(double north, double east, double length = 1.5, double width = 2.0) {
  return {{north - length / 2, east - width / 2, north + length / 2, east + width / 2}};
}
double middle(const MeshFootprint& f, std::size_t axis) {
  return (f.box[axis] + f.box[axis + 2]) / 2;
}

// A transect from one place to another; a mesh every `step`.
void transect(std::vector<MeshFootprint>& meshes, double n0, double e0, double n1, double e1,
              double step = 0.5) {
  const double length = std::hypot(n1 - n0, e1 - e0);
  const int count = static_cast<int>(length / step) + 1;
  for (int k = 0; k < count; ++k) {
    const double s = k * step / length;
    meshes.push_back(around(n0 + s * (n1 - n0), e0 + s * (e1 - e0)));
  }
}

// Pairs of near footprints that are not neighbours in time.
Closures closuresWithin(const std::vector<MeshFootprint>& meshes, double distance) {
  Closures closures;
  for (std::uint32_t a = 0; a < meshes.size(); ++a)
    for (std::uint32_t b = a + 10; b < meshes.size(); ++b)
      if (std::hypot(middle(meshes[a], 0) - middle(meshes[b], 0),
                     middle(meshes[a], 1) - middle(meshes[b], 1)) < distance)
        closures.emplace_back(a, b);
  return closures;
}

// Every touched leaf tile in exactly one piece; each piece lists exactly the meshes that reach it.
void expectDivided(const std::vector<MeshFootprint>& meshes, const TileGrid& grid,
                   const DivisionConfig& config, const std::vector<Piece>& pieces) {
  std::map<std::pair<int, int>, int> owners;
  for (const Piece& piece : pieces)
    for (int x = piece.core.x0; x < piece.core.x1; ++x)
      for (int y = piece.core.y0; y < piece.core.y1; ++y) ++owners[{x, y}];
  for (const auto& [tile, count] : owners) ASSERT_EQ(count, 1) << tile.first << ' ' << tile.second;
  for (const MeshFootprint& f : meshes) {
    const TileId low = grid.at(0, f.box[0], f.box[1]), high = grid.at(0, f.box[2], f.box[3]);
    for (int x = low.x; x <= high.x; ++x)
      for (int y = low.y; y <= high.y; ++y) ASSERT_TRUE(owners.contains({x, y})) << x << ' ' << y;
  }
  for (const Piece& piece : pieces) {
    const TileRange& c = piece.core;
    std::vector<std::uint32_t> expected;
    const double edge = grid.edge(0);
    for (std::uint32_t k = 0; k < meshes.size(); ++k) {
      const auto reaches = [&](std::size_t axis, int low, int high) {
        return meshes[k].box[axis] - config.overlap < high * edge &&
               meshes[k].box[axis + 2] + config.overlap >= low * edge;
      };
      if (reaches(0, c.x0, c.x1) && reaches(1, c.y0, c.y1)) expected.push_back(k);
    }
    ASSERT_EQ(piece.meshes, expected);
  }
}

TEST(SpaceDivision, CutsOfACrossingSurveyAvoidClosuresAndDoNotRunAlongTransects) {
  std::vector<MeshFootprint> meshes;  // lines 20 m apart, in both directions
  for (int line = 0; line < 4; ++line) transect(meshes, 0, 20 * line, 60, 20 * line);
  for (int line = 0; line < 4; ++line) transect(meshes, 20 * line, 0, 20 * line, 60);
  const Closures closures = closuresWithin(meshes, 1.0);
  ASSERT_GT(closures.size(), 50U);
  const TileGrid grid;
  const DivisionConfig config;
  const auto pieces = divideSpace(meshes, closures, grid, config);
  expectDivided(meshes, grid, config, pieces);
  EXPECT_GE(pieces.size(), 4U);
  const double edge = grid.edge(0);
  for (const Piece& piece : pieces) {
    EXPECT_LE(piece.meshes.size(), 512U);
    // No closure is severed: both middles are in the same piece or neither is.
    const auto inside = [&](std::uint32_t k) {
      return piece.core.contains(grid.at(0, middle(meshes[k], 0), middle(meshes[k], 1)));
    };
    for (const auto& [a, b] : closures) EXPECT_EQ(inside(a), inside(b)) << a << ' ' << b;
    // And no border runs within a transect: a border crosses few meshes.
    for (const int border : {piece.core.x0, piece.core.x1}) {
      int on_it = 0;
      for (const std::uint32_t k : piece.meshes)
        on_it += meshes[k].box[0] < border * edge - 0.3 && meshes[k].box[2] > border * edge + 0.3;
      EXPECT_LT(on_it, 20) << border;
    }
  }
}

TEST(SpaceDivision, ADenseLawnmowerIsDividedEvenlyWithinTheLimits) {
  std::vector<MeshFootprint> meshes;
  for (int line = 0; line < 60; ++line)
    transect(meshes, line % 2 == 0 ? 0 : 60, line, line % 2 == 0 ? 60 : 0, line);
  const TileGrid grid;
  const DivisionConfig config;
  const auto pieces = divideSpace(meshes, closuresWithin(meshes, 1.2), grid, config);
  expectDivided(meshes, grid, config, pieces);
  std::size_t least = meshes.size(), most = 0, sum = 0;
  for (const Piece& piece : pieces) {
    least = std::min(least, piece.meshes.size());
    most = std::max(most, piece.meshes.size());
    sum += piece.meshes.size();
  }
  EXPECT_LE(most, 512U);
  EXPECT_LT(static_cast<double>(most), 3 * static_cast<double>(least));
  // Where all overlap, small pieces would make every mesh many times over.
  EXPECT_LT(static_cast<double>(sum), 2.2 * static_cast<double>(meshes.size()));
}

TEST(SpaceDivision, ALongTransectIsCutAcrossAndAGapAnyway) {
  std::vector<MeshFootprint> meshes;
  transect(meshes, 0, 0, 400, 0);
  transect(meshes, 5000, 9000, 5400, 9000);
  const TileGrid grid;
  const DivisionConfig config;
  const auto pieces = divideSpace(meshes, {}, grid, config);
  expectDivided(meshes, grid, config, pieces);
  for (const Piece& piece : pieces) {
    EXPECT_LE(piece.meshes.size(), 250U);
    EXPECT_LE(piece.core.y1 - piece.core.y0, 2);
  }
}

TEST(SpaceDivision, AHoverOverOneSpotStaysWholeSinceNoCutWouldMakeItSmaller) {
  std::vector<MeshFootprint> meshes(1000, around(100, 100));
  transect(meshes, 0, 100, 200, 100);
  const TileGrid grid;
  const DivisionConfig config;
  const auto pieces = divideSpace(meshes, {}, grid, config);
  expectDivided(meshes, grid, config, pieces);
  std::size_t over = 0, most = 0;
  for (const Piece& piece : pieces) {
    over += piece.meshes.size() > 512;
    most = std::max(most, piece.meshes.size());
  }
  EXPECT_LE(over, 5U);
  // One tile and the overlap around it see no more of the transect than 2.1 m + 2 x 1.5 m + 1.5 m.
  EXPECT_LE(most, 1000U + 14);
}

TEST(SpaceDivision, EmptyAndInvalidFootprintsAreInNoPiece) {
  const TileGrid grid;
  const DivisionConfig config;
  EXPECT_TRUE(divideSpace({}, {}, grid, config).empty());
  const std::vector<MeshFootprint> nothing = {
      {{1, 1, 0, 0}}, {{kNaN, 0, 1, 1}}, {{0, 0, 1, INFINITY}}, {{-1e300, 0, 1e300, 1}}};
  EXPECT_TRUE(divideSpace(nothing, {{0, 1}, {2, 99}}, grid, config).empty());
  std::vector<MeshFootprint> some = nothing;
  some.push_back({{5, 5, 5, 5}});  // a point has a tile
  const auto pieces = divideSpace(some, {{0, 4}}, grid, config);
  ASSERT_EQ(pieces.size(), 1U);
  EXPECT_EQ(pieces[0].meshes, std::vector<std::uint32_t>{4});
  EXPECT_EQ(pieces[0].core, (TileRange{2, 2, 3, 3}));
}

TEST(SpaceDivision, EqualSurveysAreDividedEqually) {
  std::vector<MeshFootprint> meshes;
  for (int line = 0; line < 250; ++line)
    transect(meshes, line % 2 == 0 ? 0 : 38, 0.8 * line, line % 2 == 0 ? 38 : 0, 0.8 * line);
  ASSERT_GT(meshes.size(), 19000U);
  const TileGrid grid;
  const DivisionConfig config;
  const auto pieces = divideSpace(meshes, {}, grid, config), again = divideSpace(meshes, {}, grid, config);
  ASSERT_EQ(pieces.size(), again.size());
  for (std::size_t k = 0; k < pieces.size(); ++k) {
    EXPECT_EQ(pieces[k].core, again[k].core);
    EXPECT_EQ(pieces[k].meshes, again[k].meshes);
    EXPECT_LE(pieces[k].meshes.size(), 512U);
  }
}

}  // namespace
}  // namespace fathom::fusion
