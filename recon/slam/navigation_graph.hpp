#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "realtime/kernel/numbered_pool.hpp"
#include "realtime/kernel/state_archive_fwd.hpp"
#include "recon/geometry/uncertain_pose.hpp"
#include "recon/slam/dvl_calibration.hpp"
#include "recon/slam/heading_trust.hpp"
#include "recon/slam/held_fixes.hpp"
#include "recon/slam/incremental_solver.hpp"
#include "recon/slam/navigation_config.hpp"
#include "recon/slam/sensor_factors.hpp"
#include "recon/slam/shared_by_pose.hpp"

namespace fathom::slam {

// What a keyframe enters with.
struct KeyframeInput {
  std::int64_t utc_ns = 0;
  SE3 T_odom_cam;              // dead reckoning
  double unlocked_s = 0;       // since the last keyframe without bottom track [s]
  double untilted_s = 0;       // without attitude [s]
  bool attitude_held = false;  // at its time: attitude is not measured
  bool depth_held = false;     // depth is not measured
  // Depth by pressure less that of T_odom_cam, and the standard deviation that swell adds to the noise of the
  // former [m].
  double pressure_off = 0, pressure_sigma = 0;
  bool compass_jumped = false;  // since the last keyframe (nav::DeadReckoning took the leap out)
  // Turn of the body about nav's down axis since the last keyframe as the gyro has it, whole turns counted
  // [rad], and for how long of that the gyro was silent, which added nothing to it [s]; negative: no gyro at
  // all.
  double gyro_turn = 0, ungyro_s = -1;
  double range = 2;  // from the camera to the seafloor [m]
  // Standard deviation of the DVL's scale by a speed of sound that nobody measured (nav::DeadReckoning) [1].
  double sound_share = 0;
};

// kAgreed: a closure that others agree with around a cycle, whatever the graph says.
enum class LinkKind : std::uint8_t { kOdometry, kClosure, kAgreed };
enum class Taken : std::uint8_t { kYes, kContradicts, kFull, kBad };

// The vehicle's navigation as a graph of poses in information form: one pose for each stereo keyframe, and
// references of attitude (compass deviation, bias of roll and pitch) and depth (tide), which vary slowly;
// what dead reckoning, attitude, depth, fixes, visual odometry and loop closures say are its factors
// (sensor_factors.hpp). View-based (Eustice et al. 2006; Mahon et al. 2008): the vehicle's present pose is
// the newest keyframe's and dead reckoning from there. DVL scale and misalignment: DvlCalibration.
//
// What may lie has a weight, and each weight one owner (navigation_trust.cpp). Along the chain of keyframes,
// compass, gyro, DVL and visual odometry are judged against each other step by step, before any pose is
// solved for, so that a lie cannot bend the poses that judge it (HeadingTrust; velocities by what came
// before). Closures and fixes must agree with what is known, by the graph's own covariance, before they
// enter; after, their weight is Cauchy's, which switches off what the rest contradicts and on again. Of the
// horizontal links between two consecutive keyframes one always stays in force: where both lie, they are only
// widened. Fixed memory, bounded work a call; same calls, same result.
//
// A dive may be of any length: when keyframes, links or the solver are full, the keyframe that is missed
// least retires into what its measurements say about its neighbours (retirement.hpp), and so do references
// that no keyframe uses any more. What hung on it hangs on the nearest keyframe in time that is left, where
// it was.
class NavigationGraph {
 public:
  explicit NavigationGraph(const NavigationConfig& config);

  // Where odom's origin is in nav as far as known when the first keyframe comes (nav - odom, horizontal), and
  // its standard deviation; a kilometre if never said. And as positions of the USBL have it, without what
  // they share.
  void setAnchor(const Eigen::Vector2d& shift, double sigma) { anchor_ = {shift, sigma}; }
  void setUsblAnchor(const Eigen::Vector2d& shift, double sigma) { usbl_anchor_ = {shift, sigma}; }

  // The keyframe's number, counting from 0 over the whole dive; std::nullopt when there is no room and none
  // can retire.
  std::optional<int> addKeyframe(const KeyframeInput& input);

  // A keyframe that is gone. What hung on it by odometry at T_odom hangs on `onto` at T_onto * T_odom: its
  // pose is the same, T_onto = odometry(onto) pose(onto)^-1 pose(keyframe) odometry(keyframe)^-1.
  struct Retired {
    int keyframe = 0, onto = 0;
    SE3 T_onto;
  };
  // By the last addKeyframe(), in their order: one may be `onto` of an earlier one.
  [[nodiscard]] std::span<const Retired> retired() const { return retired_; }

  using Prediction = UncertainPose;
  // Keyframe b seen from a, with the same. Of keyframes that step() has taken in.
  [[nodiscard]] Prediction predict(int a, int b);

  // T_a_b of two keyframes' cameras as they saw each other, with the covariance of its right perturbation.
  // Visual odometry of the newest step, before step(), is judged with the step's other sensors. A closure
  // that contradicts what is known is turned away, until so many that agree with each other say the same.
  // `confirmed`: visual odometry from an earlier keyframe, without dead reckoning as prior, says the same.
  Taken addLink(LinkKind kind, int a, int b, const SE3& seen, const Matrix6d& covariance,
                bool confirmed = false);

  // Visual odometry of the step to a keyframe anew: its features are seen through a rig that is known better.
  void renewOdometry(int keyframe, const SE3& seen, const Matrix6d& covariance);

  // A position fix of an antenna at `antenna_in_odom`, whenever it arrives: it holds at keyframe `at`, the
  // nearest in time, and odometry knows the way between. `sigma`: of either component [m]. `by_usbl`: shares
  // its shift and turn with all other positions of the USBL (SensorNoise), which are a pose of the graph.
  Taken addFix(int at, const Eigen::Vector3d& antenna_in_odom, const Eigen::Vector2d& north_east,
               double sigma, bool by_usbl);

  // The rig that visual odometry looks through was changed so that its ranges grew by (scale [1], per metre
  // [1/m]); see DvlCalibration.
  void rigChanged(const Eigen::Vector2d& growth) {
    if (dvl_.rigChanged(growth)) ++curved_;
  }
  // It was measured for the first time, or anew after a knock: DvlCalibration::rigBeganAnew(). What steps
  // after `since_ns` contradicted was the rig's error, not the DVL's: `knocked`, their visual odometry is
  // rejected.
  void rigBeganAnew(double turn_sigma, std::int64_t since_ns, bool knocked);

  // Judges the newest step by all that has come of it; addKeyframe() and step() do so.
  void judge();
  // A bounded part of the work that is to do.
  StepReport step();

  // So far: the newest has this number less one. Of a keyframe that has retired nothing may be asked.
  [[nodiscard]] int keyframes() const { return frames_.next(); }
  [[nodiscard]] bool has(int keyframe) const { return frames_.has(keyframe); }
  // Those that have not retired, rising.
  [[nodiscard]] std::span<const int> living() const { return frames_.numbers(); }
  [[nodiscard]] const SE3& pose(int keyframe) const {
    return solver_.pose(frames_[at(keyframe)].node);
  }  // T_nav_cam
  [[nodiscard]] const SE3& odometry(int keyframe) const { return frames_[at(keyframe)].T_odom_cam; }
  [[nodiscard]] std::int64_t utcNs(int keyframe) const { return frames_[at(keyframe)].utc_ns; }
  // Of its right perturbation: the graph's, and what links share that it takes for independent. Of their
  // turns (DvlCalibration::curl()) that is what they move each pose by (SharedByPose). Else, to first order,
  // it is an error e of the scale of all paths (SensorNoise::visual_scale, or the DVL's where no image has
  // calibrated it) and one h of their direction (the DVL's mounting likewise), which move a place by e d + h
  // (down x d), d from the middle of the fixes, which hold the survey there; fixes apart from each other tell
  // e and h in turn.
  [[nodiscard]] Matrix6d covariance(int keyframe);
  // From the newest keyframe: where odom is now. Identity without keyframes.
  [[nodiscard]] SE3 T_nav_odom() const;
  // Compass deviation at the newest keyframe [rad].
  [[nodiscard]] double deviation() const;
  // What all positions of the USBL are found to share: where their frame is, less where it was before
  // [m, north and east], and its turn; identity where none has come.
  [[nodiscard]] SE3 usblCorrection() const;
  // Height of the sea over nav's zero at the newest reference of depth, or what the pressure sensor reads too
  // much [m].
  [[nodiscard]] double seaHeight() const;

  // The keyframe that has moved most since its pose was last taken here; std::nullopt when none moved by more
  // than change_m or change_rad. Taking it marks it as known.
  std::optional<int> takeChange();
  // Marks all as known.
  void takeAllChanges();
  [[nodiscard]] std::size_t changesWaiting() const { return changed_.size(); }

  struct Counters {
    std::uint64_t keyframes = 0, keyframes_refused = 0, keyframes_retired = 0, references = 0,
                  references_retired = 0;
    std::uint64_t odometry_links = 0, closures = 0, links_contradicting = 0, links_off = 0, links_refused = 0;
    std::uint64_t fixes = 0, fixes_gated = 0, fixes_off = 0, fixes_refused = 0;
    std::uint64_t steps_contradicted = 0, steps_left_out = 0, compass_jumps = 0, attitude_absent = 0,
                  depth_absent = 0, dvl_absent = 0;
    // Keyframes whose compass reading, and steps whose visual odometry, is not believed now.
    std::uint64_t compass_distrusted = 0, visual_distrusted = 0;
    bool dvl_lies = false;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }
  // Whether the newest step, or more before it, contradicts the DVL: how far it says that the vehicle went
  // tells nothing.
  [[nodiscard]] bool dvlDoubted() const { return counters_.dvl_lies || contradictions_ > 0 || slips_ > 0; }

  // Poses and what the sensors alone say of them, as a batch solver takes it: all factors that are in force
  // but links and fixes. Pose 0 is nav's origin. Of a graph of which nothing has retired.
  [[nodiscard]] PoseGraph sensorGraph() const;
  [[nodiscard]] int node(int keyframe) const { return frames_[at(keyframe)].node; }
  [[nodiscard]] const DvlCalibration& dvl() const { return dvl_; }
  // Whether the visual odometry of the step to a keyframe is an inlier; true where there is none. And the
  // weight of its information; 0 where there is none.
  [[nodiscard]] bool visualBelieved(int keyframe) const { return !frames_[at(keyframe)].visualLies(); }
  [[nodiscard]] double visualWeight(int keyframe) const {
    const int link = frames_[at(keyframe)].link;
    return link < 0 ? 0 : solver_.measurement(link).weight;
  }
  [[nodiscard]] const IncrementalSolver& solver() const { return solver_; }
  [[nodiscard]] std::size_t memoryBytes() const;

  // Into a graph of the same configuration: every pose bit by bit, the solver's factor anew. A graph whose
  // load() failed is of no use.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader);

 private:
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self);
  template <typename Archive, typename Self>
  static void exchangeFrame(Archive& archive, Self& frame);
  template <typename Archive, typename Self>
  static void exchangeRobust(Archive& archive, Self& robust);
  [[nodiscard]] bool connect();  // what was loaded; false when it contradicts itself

  struct Frame {
    std::int64_t utc_ns = 0;
    SE3 T_odom_cam;
    SE3 known;                            // pose that takeChange() last gave
    int node = 0;                         // in the solver
    int step = -1;                        // measurement of the step from the keyframe before
    int attitude = -1;                    // and of attitude
    int drift = -1;                       // and of the reference that begins here
    int link = -1;                        // and of visual odometry from the keyframe before
    SeenTurn seen;                        // by that
    double gyro_turn = 0, ungyro_s = -1;  // of the step
    double range = 2;                     // [m]
    bool leapt = false;                   // the compass, on the step
    bool mixed = false;                   // its reference began before the compass's present one
    StepQuality quality;                  // of that step
    double step_weight = 1;               // its share of information where the compass turned it wrongly
    HeadingTrust::Verdict heading;
    bool dvl_lies = false, link_slips = false;  // by their velocities
    std::array<bool, 3> counted{};              // as lying: compass, visual odometry, DVL
    [[nodiscard]] bool visualLies() const { return link >= 0 && (!heading.visual || link_slips); }
    bool waiting = false;  // in changed_

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      exchangeFrame(archive, self);
    }
  };
  // A factor with a robust weight.
  struct Robust {
    int from = kWorld, to = 0;  // nodes
    SE3 T_from_to;
    Matrix6d spread;  // a link's covariance, of which its information follows; a fix's information
    int measurement = 0;
    double free_chi2 = 0;  // up to there its weight is 1
    double weight = 1;
    bool fix = false, off = false;
    bool insists = false;  // of many that say the same: its weight stays 1
    Eigen::Vector4d straightened_by = Eigen::Vector4d::Zero();  // DvlCalibration::curl() that a link is
    int curved = 0;                                             // curved_ when a link was seen

    [[nodiscard]] RelativePose factor() const {
      return fix ? RelativePose{from, to, T_from_to, spread} : linkFactor(from, to, T_from_to, spread);
    }

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      exchangeRobust(archive, self);
    }
  };
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  // Horizontal covariance of a place so far from one that is held, by errors that all links share [m^2].
  [[nodiscard]] Eigen::Matrix2d sharedError(const Eigen::Vector2d& from_held) const;
  // With more of the place in nav, horizontal [m^2].
  [[nodiscard]] static Matrix6d widened(Matrix6d covariance, const SE3& T_nav_cam, const Eigen::Matrix2d& by);
  // Of nodes, with what turns that links share do.
  [[nodiscard]] Matrix6d relativeCovariance(int from, int to);
  void followShared();
  void pullShared();
  void pullClosures();
  template <typename Take>
  void forLevelTurns(const Take& take) const;
  void forgetReplaced();
  [[nodiscard]] Eigen::Vector2d startingShift() const;
  void addAnchors(const Frame& frame, const SE3& T_nav_cam);
  [[nodiscard]] double anchorSigma() const;
  void releaseGauge();
  void addUsbl(const Eigen::Vector2d& north_east, double sigma);
  [[nodiscard]] int addNode(const SE3& pose);
  [[nodiscard]] int addFactor(const RelativePose& factor);  // -1 when refused
  void refer(const KeyframeInput& input, Frame& frame);
  void referDepth(const KeyframeInput& input, int node);
  [[nodiscard]] StepTurns turnsOf(const Frame& from, const Frame& to) const;
  [[nodiscard]] bool linkFitsButForYaw(const Frame& from, const Frame& to, double contradiction) const;
  void judgeVelocity(Frame& from, Frame& to);
  void learnTurn(int a, int b, const UncertainPose& seen);
  void learnCurves();
  void weigh(Frame& frame);
  void takeVerdicts(int keyframe);
  void moveAstray(int a, int b, const SE3& T_a_b);
  [[nodiscard]] bool agreesWithRefused(int a, int b, const SE3& T_a_b, const Matrix6d& covariance);
  [[nodiscard]] bool insists(std::int64_t utc_ns, const Eigen::Vector2d& innovation, double sigma);
  void reweight(bool settled);
  void straightenAnew(Robust& r);
  [[nodiscard]] bool fits(const Robust& r);
  void noteChanges();
  [[nodiscard]] double distance2(const RelativePose& factor, const Matrix6d& covariance) const;

  NavigationConfig config_;
  IncrementalSolver solver_;
  DvlCalibration dvl_;
  SharedByPose shared_, closures_;             // DvlCalibration::curl() by all links, and level by closures
  bool of_closures_ = false, pulled_ = false;  // followed now; all that pulls is in it
  rt::NumberedPool<Frame> frames_;
  std::vector<int> frame_of_node_;  // -1: a reference
  std::vector<Robust> robust_;
  std::vector<int> changed_;  // keyframes
  std::vector<int> astray_;   // nodes that moveAstray() moves
  std::size_t next_robust_ = 0, newest_robust_ = 0;
  struct Anchor {
    Eigen::Vector2d shift = Eigen::Vector2d::Zero();         // nav - odom [m]
    double sigma = std::numeric_limits<double>::infinity();  // [m]

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.shift, self.sigma);
    }
  } anchor_, usbl_anchor_;
  int gauge_ = -1;  // measurement of the first keyframe's place, while nothing tells it
  HeldFixes held_;
  // The frame of all positions of the USBL: at the first of them, level.
  struct Usbl {
    int node = -1;
    SE3 T_nav_usbl;    // as it was before
    double sigma = 0;  // of what they share, before [m]
    int fixes = 0;     // that were accepted

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.node, self.T_nav_usbl, self.sigma, self.fixes);
    }
  } usbl_;
  struct Reference {
    int node = -1;
    std::int64_t utc_ns = 0;
    double heading = 0;
    bool of_depth = false;

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.node, self.utc_ns, self.heading, self.of_depth);
    }
  };
  static constexpr std::size_t kRetiredAtOnce = 2;  // keyframes for one that comes
  [[nodiscard]] int newReference(const SE3& start);
  [[nodiscard]] bool servesAgain(std::int64_t utc_ns, double heading);
  void makeRoom();
  [[nodiscard]] bool retireKeyframe();
  void retireReference();
  [[nodiscard]] bool retireNode(int node);
  void forget(int measurement, int other_end);
  void moveRobust(std::size_t from, std::size_t to);
  [[nodiscard]] int nearestInTime(int keyframe, std::int64_t utc_ns) const;

  std::vector<int> robust_of_;           // of a measurement: its place in robust_; -1: none
  std::vector<std::uint8_t> must_stay_;  // of a node: 1 unless it is a keyframe
  std::vector<Retired> retired_;
  std::vector<Reference> references_;  // oldest first
  std::size_t next_reference_ = 0;     // to be looked at for retirement
  int reference_credit_;               // in quarters of a reference
  std::int64_t jumped_ns_ = 0;         // references before this do not serve again
  Reference attitude_, depth_, tide_;
  bool jump_waits_ = false;
  HeadingTrust heading_;
  // Visual odometry of the newest step, until it is judged.
  struct Seen {
    bool waits = false, linked = false, confirmed = false;
    UncertainPose link;
    SE3 T_a_b;  // before DvlCalibration::straightened()

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.waits, self.linked, self.confirmed, self.link.T_a_b, self.link.covariance, self.T_a_b);
    }
  } seen_;
  // Of the newest step, level, ahead and to starboard, by what is believed [m/s].
  Eigen::Vector2d velocity_ = Eigen::Vector2d::Zero();
  int contradictions_ = 0, slips_ = 0, agreements_ = 0;  // steps in a row
  int rig_ = 0, curved_ = 0;  // times that it began anew, and that curl() became another
  // Fixes outside the gate that agree with each other: how many, since when, and their mean innovation [m].
  struct Insistence {
    int fixes = 0;
    std::int64_t since_ns = 0;
    Eigen::Vector2d innovation = Eigen::Vector2d::Zero();

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.fixes, self.since_ns, self.innovation);
    }
  } insistence_;
  std::int64_t trouble_ns_ = 0,
               fix_agreed_ns_ = 0;  // last time that a sensor of the chain lied; that a fix fit
  struct Refused {                  // a closure that contradicts
    int a = -1, b = -1;
    UncertainPose link;

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.a, self.b, self.link.T_a_b, self.link.covariance);
    }
  };
  std::array<Refused, 16> refused_;  // the newest, in turn
  std::uint64_t next_refused_ = 0;
  Counters counters_;
};

}  // namespace fathom::slam
