#pragma once

#include <array>
#include <filesystem>
#include <vector>

namespace fathom::sim {

// How far features are off and what a front end states of it, as quantiles from a CSV file with the header
// kHeader and rows by rising share from 0 to 1: so large a share of features is not above the row's values.
//   place_ratio      length of the place's error from view to view over its stated sigma along one axis
//   match_ratio      magnitude of the match's error along x, or y, over its stated sigma
//   stated_match_px  that sigma [px]
//   size, stated_place  of a feature, and its place's stated sigma, which grows with the size; both over the
//                    image's width
// `fathom-report match-errors` measures such a file on missions of pictures.
class MatchErrors {
 public:
  static constexpr const char* kHeader = "share,place_ratio,match_ratio,stated_match_px,size,stated_place";

  // Throws InputError, which names the line.
  explicit MatchErrors(const std::filesystem::path& file);
  // The shipped one: of the undisturbed dives of the campaign, rendered.
  [[nodiscard]] static std::filesystem::path shipped();

  // `share`: 0 to 1; between rows linear.
  [[nodiscard]] double placeRatio(double share) const { return between(kShare, share, kPlaceRatio); }
  [[nodiscard]] double matchRatio(double share) const { return between(kShare, share, kMatchRatio); }
  [[nodiscard]] double statedMatch_px(double share) const { return between(kShare, share, kStatedMatch); }
  [[nodiscard]] double statedPlace(double size) const { return between(kSize, size, kStatedPlace); }

 private:
  enum Column : std::size_t { kShare, kPlaceRatio, kMatchRatio, kStatedMatch, kSize, kStatedPlace, kColumns };
  [[nodiscard]] double between(Column at, double value, Column wanted) const;

  std::array<std::vector<double>, kColumns> columns_;  // each rising
};

}  // namespace fathom::sim
