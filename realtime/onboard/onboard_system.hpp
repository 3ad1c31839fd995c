#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "firmware_if/mission/mission.hpp"
#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "realtime/onboard/link/link_core.hpp"
#include "realtime/onboard/map/map_core.hpp"
#include "realtime/onboard/nav/nav_core.hpp"
#include "realtime/onboard/onboard_config.hpp"
#include "recon/geometry/sensor_samples.hpp"
#include "telemetry/downlink/downlink.hpp"

namespace fathom::onboard {

// Sets position and attitude of the body in a status.
void placeIn(telemetry::Status& status, const SE3& T_nav_body);

// The three cores wired together for one mission: samples in, poses, map and modem frames out. No threads,
// files, sockets or clocks; time is that of the samples.
class OnboardSystem {
 public:
  // Gives the pixels of an exposure, valid until the next call for the same side; std::nullopt: unreadable.
  using ImageSource = std::function<std::optional<ImageView>(const std::string& file_name, CameraSide side)>;
  // Gives the matches of a pair, by its left image's name, where a mission has no images; null: unreadable.
  using FeatureSource = std::function<const StereoFeatureFrame*(const std::string& left_image)>;
  struct PairSource {
    ImageSource images;
    FeatureSource features;  // set: instead of images
  };

  // How much work a pair may cost. Where a measured time decided it, the log says so (io::Decision).
  struct PairQuota {
    std::size_t level = 0;     // of degradation, for the counters
    bool drop = false;         // not mapped at all
    double feature_share = 1;  // of the wanted stereo points; fewer make coarser cells
    bool closures = true;      // false: candidates wait
    double rebuild_share = 1;  // of the meshes fused again per pair
  };
  static constexpr std::size_t kLevels = 5;

  // Result of a stereo pair, with the names of its images: at its final pose, or at the predicted one right
  // after the images were processed.
  struct MappedPair {
    MapOutput output;
    std::string left_image, right_image;
    double left_exposure_s = 0, right_exposure_s = 0;
    std::optional<double> altitude;  // [m]
  };

  OnboardSystem(const OnboardConfig& config, const io::MissionConfig& mission, const StereoRig& rig,
                PairSource source, const MapSlots& slots = {});

  using OnPair = std::function<void(const MappedPair&)>;
  // Consumes one sample that arrived at `arrival_utc_ns`; calls `on_pair` for every pair that it gives a
  // final pose.
  void consume(std::int64_t arrival_utc_ns, const SensorSample& sample, const OnPair& on_pair);

  // Decides what a pair may cost; of `pair` only the images' names are known.
  using PairPolicy = std::function<PairQuota(const StereoTrigger& trigger, const MappedPair& pair)>;

  // Time passes without a sample.
  void passTime(std::int64_t now_ns);
  // Asked for every pair before it is mapped; without one all work is done.
  void setPairPolicy(PairPolicy policy) { policy_ = std::move(policy); }
  // Health flags (telemetry's) of what the cores cannot see. Initially soft real time, as in a replay.
  // `skipped`: cycles of the hard loop that were skipped so far.
  void setProgramHealth(unsigned flags, std::uint32_t skipped) {
    program_health_ = flags;
    skipped_cycles_ = skipped;
  }

  // Called for every pair when its images have been processed and are no longer needed.
  void setSeenObserver(OnPair on_seen) { on_seen_ = std::move(on_seen); }
  // Called with a pair's number before it is placed.
  void setPlacingObserver(std::function<void(std::uint32_t pair)> on_placing) {
    on_placing_ = std::move(on_placing);
  }

  // The survey is over: localisation and map come to their final state. Pairs without a final pose keep the
  // predicted one.
  void finish(std::int64_t now_ns, const OnPair& on_pair);

  // Link time passes; the next frame to send or 0. Call until 0. `survey_over`: nothing more will be mapped.
  [[nodiscard]] std::size_t nextFrame(std::int64_t now_ns, bool survey_over, std::span<std::uint8_t> out);

  // A frame that the modem received: acknowledgements and requests go to the link, position fixes to the map;
  // other frames are counted.
  void receiveFrame(std::int64_t now_ns, std::span<const std::uint8_t> frame);

  // Saved state; a loaded system continues like the saved one (see checkpoint/README.md). A system is
  // unusable after its load() failed.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);
  // The program has started again: frames may have been sent that it does not know of.
  void noteRestart() { link_.noteRestart(); }
  // Frames before this sequence number were given to the modem, by this or another process.
  void noteSent(telemetry::Version next, std::int64_t now_ns) { link_.noteSent(next, now_ns); }
  // False: pairs are ignored until it is set again, navigation continues. Not part of the saved state.
  void setMapping(bool mapping) { mapping_ = mapping; }

  // Names and values of every counter, for health.csv.
  [[nodiscard]] std::vector<std::pair<std::string, double>> health() const;
  [[nodiscard]] telemetry::Status status(std::int64_t now_ns) const;

  [[nodiscard]] const MapCore& map() const { return map_; }
  [[nodiscard]] Mesh mapMesh() { return map_.mesh(); }  // as MapCore's
  [[nodiscard]] bool slotsHold() { return map_.slotsHold(); }
  // Called with the stage's name when it ends: "images" and those of MapCore. For a caller that has a clock.
  void setStageObserver(std::function<void(const char* stage)> observer) {
    observer_ = observer;
    map_.setStageObserver(std::move(observer));
  }
  // Called when a keyframe retires, for the owner of pairs that are anchored to it.
  void setRetiredObserver(LocalisationCore::OnRetired observer) {
    map_.setRetiredObserver(std::move(observer));
  }
  [[nodiscard]] const LinkCore& link() const { return link_; }
  [[nodiscard]] std::uint64_t unreadableImages() const { return unreadable_images_; }
  [[nodiscard]] const NavCore& nav() const { return nav_.core(); }

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  void addFix(nav::FixKind kind, std::int64_t utc_ns, double latitude, double longitude, double sigma);
  struct Fix {
    nav::FixKind kind = nav::FixKind::kGps;
    std::int64_t utc_ns = 0;
    Eigen::Vector2d north_east = Eigen::Vector2d::Zero();  // in nav [m]
    double sigma = 0;                                      // horizontal [m]

    static void exchange(auto& archive, auto& self) {
      archive.enumeration(self.kind, nav::FixKind::kUsbl);
      archive.instants(self.utc_ns);
      archive(self.north_east, self.sigma);
    }
  };
  void place(const Fix& fix, const SE3& T_odom_body, double unlocked_s);
  // A fix from before bottom track: the vehicle is assumed where dead reckoning began, after as long without
  // it as has passed since.
  void placeEarly(const Fix& fix);
  // Places the fixes that waited, as soon as dead reckoning has begun.
  void placeEarlyFixes();
  // Puts the pair's images or features into the input; false where they cannot be read.
  [[nodiscard]] bool readPair(const MappedPair& pair, MapInput& input) const;
  void addImage(const ImageEvent& event, std::int64_t arrival_utc_ns);
  // False when so many exposures came since that the names are gone.
  [[nodiscard]] bool nameImages(const StereoTrigger& trigger, MappedPair& pair) const;
  void mapPairs(const OnPair& on_pair);
  // False where a pair is not to be mapped, or cannot be.
  [[nodiscard]] bool seePair(const StereoTrigger& trigger, MappedPair& pair, SeenPair& seen);
  // Places the waiting pairs up to this number, at their predicted poses if no final one is known.
  void placePairs(std::uint32_t up_to, const StereoTrigger* last, const OnPair& on_pair);
  void addDownlink(std::vector<std::pair<std::string, double>>& row) const;
  void addLocalisation(std::vector<std::pair<std::string, double>>& row) const;
  void updateTrack(std::int64_t now_ns);
  [[nodiscard]] std::uint16_t healthFlags(std::int64_t now_ns,
                                          const fusion::QuadtreeMap::Counters& tiles) const;

  static constexpr std::int64_t kTickInterval_ns = 500'000'000;  // between health ticks and status updates

  OnboardConfig config_;
  io::MissionConfig mission_;
  LocalTransverseMercator local_;
  PairSource source_;
  std::function<void(const char* stage)> observer_;
  NavFeed nav_;
  MapCore map_;
  LinkCore link_;
  telemetry::DownlinkReceiver downlink_;
  MissionProgress progress_;
  struct ImageName {
    std::uint32_t frame = UINT32_MAX;
    std::string text;
    double exposure_s = 0;
  };
  static constexpr std::size_t kNames = 256;   // of the newest exposures; no pair waits for longer
  std::array<ImageName, kNames> image_names_;  // by frame number
  // Of the pairs that wait for their final place.
  struct WaitingPair {
    StereoTrigger trigger;  // its prediction
    SeenPair seen;

    static void exchange(auto& archive, auto& self) {
      archive(self.trigger);
      SeenPair::exchange(archive, self.seen);
    }
  };
  static constexpr std::size_t kWaitingPairs = 32;  // as NavCore's
  rt::FixedQueue<WaitingPair, kWaitingPairs> waiting_;
  double last_correction_ = 0;  // of a predicted place [m]
  OnPair on_seen_;
  std::function<void(std::uint32_t pair)> on_placing_;
  PairPolicy policy_;
  bool mapping_ = true;
  unsigned program_health_ = telemetry::kHealthSoftRealTime;
  std::uint32_t skipped_cycles_ = 0;
  std::uint64_t shed_pairs_ = 0;
  std::array<std::uint64_t, kLevels> pairs_at_level_{};
  std::optional<SE3> last_pose_;  // T_odom_body, for the distance travelled
  double distance_ = 0;           // since dead reckoning began [m]
  std::uint64_t unreadable_images_ = 0;
  // Before dead reckoning: the newest, as a minute of GPS or the pings of a long descent.
  static constexpr std::size_t kEarlyFixes = 256;
  rt::FixedQueue<Fix, kEarlyFixes> early_fixes_;
  SE3 odometry_began_;                  // T_odom_body
  std::int64_t odometry_began_ns_ = 0;  // 0: not yet
  std::uint64_t fixes_without_odometry_ = 0;
  std::int64_t last_pair_ns_ = 0, last_tick_ns_ = 0;
  std::size_t last_points_ = 0;  // of the newest pair
  bool survey_over_ = false;
  std::optional<BatterySample> battery_;     // the newest
  std::optional<double> reported_progress_;  // of the mission, by the vehicle's own control
};

}  // namespace fathom::onboard
