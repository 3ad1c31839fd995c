#include "tests/monitor/storm/ground.hpp"

#include <cmath>

#include "tests/telemetry/sample_tile.hpp"

namespace fathom::test {

std::size_t Ground::change(std::mt19937& random) {
  const auto draw = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const std::size_t at = random() % squares_.size();
  Square& s = squares_[at];
  s.tile.reset();
  for (auto& detail : s.details) detail.reset();
  if (!s.known || s.empty) {
    s.known = true;
    s.empty = false;
    s.seen = draw(0.3, 1);
    s.rise_m = draw(-1, 1);
  } else if (const double what = draw(0, 1); what < 0.3) {
    s.seen = draw(s.seen, 1);
  } else if (what < 0.8) {
    s.rise_m += draw(0, 1) < 0.5 ? draw(0.1, 1) : -draw(0.1, 1);
  } else {
    s.empty = true;
  }
  return at;
}

void Ground::apply(const Square& s, HeightTile& tile) const {
  for (HeightTile::Node& node : tile.nodes) {
    if (!s.known || s.empty) node.coverage = 0;
    node.depth = static_cast<float>(node.depth - s.rise_m);
  }
}

const HeightTile& Ground::tile(std::size_t square) const {
  const Square& s = squares_[square];
  const auto at = static_cast<int>(square);
  if (!s.tile) {
    s.tile = std::make_unique<HeightTile>(telemetry::sampleTile(at / side_, at % side_, kSquare_m, s.seen));
    apply(s, *s.tile);
  }
  return *s.tile;
}

std::optional<std::size_t> Ground::squareAt(double north, double east) const {
  const double n = std::floor(north / kSquare_m), e = std::floor(east / kSquare_m);
  if (n < 0 || e < 0 || n >= side_ || e >= side_) return std::nullopt;
  return static_cast<std::size_t>(static_cast<int>(n) * side_ + static_cast<int>(e));
}

HeightTile Ground::coarse(std::size_t square) const {
  constexpr int kRatio = 4;
  const int row = static_cast<int>(square) / side_ / kRatio,
            column = static_cast<int>(square) % side_ / kRatio;
  HeightTile tile;
  tile.north_index = row;
  tile.east_index = column;
  tile.level = 1;
  tile.size = kRatio * kSquare_m;
  for (int n = 0; n < kRatio && row * kRatio + n < side_; ++n)
    for (int e = 0; e < kRatio && column * kRatio + e < side_; ++e) {
      const HeightTile& fine =
          this->tile(static_cast<std::size_t>((row * kRatio + n) * side_ + column * kRatio + e));
      for (int i = 0; i < HeightTile::kCells / kRatio; ++i)
        for (int j = 0; j < HeightTile::kCells / kRatio; ++j)
          tile.at(n * kRatio + i, e * kRatio + j) = fine.at(i * kRatio, j * kRatio);
    }
  return tile;
}

const HeightTile& Ground::detail(std::size_t square, int quarter) const {
  const Square& s = squares_[square];
  const auto at = static_cast<int>(square);
  auto& tile = s.details[static_cast<std::size_t>(quarter)];
  if (!tile) {
    tile = std::make_unique<HeightTile>(
        telemetry::sampleTile(at / side_ * 2 + quarter / 2, at % side_ * 2 + quarter % 2, kSquare_m / 2));
    apply(s, *tile);
  }
  return *tile;
}

}  // namespace fathom::test
