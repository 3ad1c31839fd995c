#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "tests/bench/lighting/corrections.hpp"

namespace fathom::bench {

// Frames side by side in colour, a row for each of the corrections; and one frame at full size, before and
// after.
class Strip {
 public:
  Strip(const TrueMission& mission, std::vector<int> corrections)
      : mission_(mission), corrections_(std::move(corrections)), rows_(corrections_.size()) {}

  void add(const CorrectedPair& pair);
  void write(const std::filesystem::path& png) const;
  // The left image under two corrections, one above the other.
  static void writePair(const TrueMission& mission, const CorrectedPair& pair, int before, int after,
                        const std::filesystem::path& png);

 private:
  const TrueMission& mission_;
  std::vector<int> corrections_;
  std::vector<std::vector<std::vector<std::uint8_t>>> rows_;  // frames in RGB
};

}  // namespace fathom::bench
