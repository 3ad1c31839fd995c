#pragma once

#include <optional>
#include <vector>

#include "recon/calibration/rig_history.hpp"
#include "recon/navigation/graph/navigation_batch.hpp"
#include "recon/topside/config/topside_config.hpp"
#include "recon/topside/input/mission_input.hpp"
#include "recon/topside/input/survey_stage.hpp"
#include "recon/topside/localise/feature_stage.hpp"

namespace fathom::topside {

// What navigation gives the network of poses, by frame.
[[nodiscard]] std::vector<slam::KeyframeInput> inputsOf(const Frames& frames, const Navigation& navigation);
// USBL fixes, and GPS of a vehicle that came up during the dive, each at the frame nearest to it in time.
// What GPS said before, the anchor has.
[[nodiscard]] std::vector<slam::NavigationFix> fixesOf(const Frames& frames, const Navigation& navigation,
                                                       const slam::SensorNoise& noise);
// `graph` for the mission's mounting and tide.
[[nodiscard]] slam::NavigationConfig graphOf(const io::MissionConfig& mission, slam::NavigationConfig graph);
// Steps that neither images (`links`) nor bottom track measure get the vehicle's velocity of the nearest
// steps that images do measure, in place of 'unknown': a vehicle changes it slowly. Later inputs, and fixes
// seen from them, move along.
void bridge(std::vector<slam::KeyframeInput>& inputs, std::vector<slam::NavigationFix>& fixes,
            const std::vector<slam::NavigationLink>& links, double unknown_velocity);
// Frames, few in a row, that neither images, bottom track nor such a velocity join to the others: where they
// are is known to decimetres, and they would spoil a surface that is known to millimetres.
[[nodiscard]] std::vector<std::uint32_t> unjoined(const std::vector<slam::KeyframeInput>& inputs,
                                                  const std::vector<slam::NavigationLink>& links,
                                                  double unknown_velocity);

// How far stamps are off beside what mission.toml says, as turns of the vehicle show it by images and by the
// attitude sensor: a compass that filters its readings is late; so are images whose camera has a clock of its
// own. A DVL's steps through turns distinguish one from the other.
struct SensorTiming {
  double attitude_late = 0;  // roll, pitch and heading were measured so long before their stamps [s]
  double images_late = 0;    // images were taken so long after theirs [s]
  double sigma = 0;          // standard deviation of the one that is not 0 [s]

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.attitude_late, self.images_late, self.sigma);
  }
};

// Navigation with stamps put right, where visual odometry (`links`, of all frames) shows that they are off
// and by what the steps contradict dead reckoning less.
struct Retimed {
  SensorTiming timing;
  Navigation navigation;
};
[[nodiscard]] std::optional<Retimed> retimed(const MissionInput& input, const TopsideConfig& config,
                                             const Survey& survey, const FeatureStore& features,
                                             const std::vector<slam::NavigationLink>& links);

// By which ranges and paths of the images have to be multiplied at the usual range, as the DVL's paths show
// it in a dive too short or restless for findRig() to use them: the turn of one camera towards the other,
// which makes all ranges wrong, is then what its epipolar lines leave open. Weighed by what is known of both.
// Where findRig() used some of them, it is sought if all of them contradict that. `of_pairs`: links by pair.
struct ImageScale {
  double scale = 1, sigma = 0;  // sigma 0: not sought
  double range = 1;             // at which they are so, as it then is [m]
  int steps = 0;

  // As that turn makes it: twice as much at twice the range.
  [[nodiscard]] calibration::RangeError error() const { return {0, (1 - scale) / range}; }

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.scale, self.sigma, self.range, self.steps);
  }
};
[[nodiscard]] ImageScale imageScaleOf(const MissionInput& input, const TopsideConfig& config,
                                      const Navigation& navigation, const Frames& frames,
                                      const std::vector<slam::NavigationLink>& of_pairs);

}  // namespace fathom::topside
