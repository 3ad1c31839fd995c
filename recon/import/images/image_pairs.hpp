#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "firmware_if/mission/mission.hpp"

namespace fathom::topside {

struct ImagePair {
  std::int64_t utc_ns = 0;                 // of the left exposure, by the vehicle's clock
  std::string left, right;                 // file names within img/
  std::vector<std::string> colour = {};    // the same of the colour cameras; empty: none of this moment
  std::array<double, 2> exposures_s = {};  // left and right, as stamped; 0: not known

  // Of a camera as MissionInput numbers them.
  [[nodiscard]] double exposureOf(std::size_t camera) const {
    return camera < exposures_s.size() ? exposures_s[camera] : 0;
  }

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.utc_ns, self.left, self.right, self.colour, self.exposures_s);
  }
};

struct PairList {
  std::vector<ImagePair> pairs;                   // by time
  std::uint64_t left_alone = 0, right_alone = 0;  // images without their partner
  bool from_file_names = false;  // the log has no image events: times from the names, to the millisecond
  bool features_only = false;    // the mission has features/ and no img/

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.pairs, self.left_alone, self.right_alone, self.from_file_names, self.features_only);
  }
};

// The mission's stereo pairs: of the image events in its log, or, where there are none, of the files in img/
// or features/.
// Times get mission.toml's offsets, and in a log follow the cameras' drift (nav::CameraClock); a pair is a
// left and a right image no more than `tolerance` [s] apart. Throws InputError when there is not one pair.
[[nodiscard]] PairList listPairs(const io::MissionPaths& paths, const io::MissionConfig& mission,
                                 double tolerance);

}  // namespace fathom::topside
