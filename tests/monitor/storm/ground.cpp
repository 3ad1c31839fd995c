#include "tests/monitor/storm/ground.hpp"

#include "tests/telemetry/sample_tile.hpp"

namespace fathom::test {

std::size_t Ground::change(std::mt19937& random) {
  const auto draw = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  const std::size_t at = random() % squares_.size();
  Square& s = squares_[at];
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

HeightTile Ground::tile(std::size_t square) const {
  const Square& s = squares_[square];
  const auto at = static_cast<int>(square);
  HeightTile tile = telemetry::sampleTile(at / side_, at % side_, kSquare_m, s.seen);
  for (HeightTile::Node& node : tile.nodes) {
    if (!s.known || s.empty) node.coverage = 0;
    node.depth = static_cast<float>(node.depth - s.rise_m);
  }
  return tile;
}

}  // namespace fathom::test
