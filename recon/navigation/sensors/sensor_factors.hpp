#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "recon/geometry/se3.hpp"
#include "recon/solver/pose_graph.hpp"

namespace fathom::slam {

// Errors of a vehicle's navigation sensors, as standard deviations. The defaults are those of a Sirius-class
// vehicle (Johnson-Roberson et al. 2010, table 1) with a magnetic compass.
struct SensorNoise {
  // Doppler velocity log, as dead reckoning between two poses uses it.
  double dvl_velocity = 0.002;  // white, of each ensemble [m/s]
  double dvl_rate = 5.0;        // ensembles [1/s]
  double dvl_scale = 0.002;     // of the velocity, constant [1]
  double dvl_heading = 0.006;   // of its forward axis against the camera, constant [rad]
  // Of the velocity, correlated over a time (Gauss-Markov): recorded dives at 1.9 m/s err by 2.3 m in 100 s.
  double dvl_wander = 0.026, dvl_wander_s = 10;  // [1], [s]
  double dvl_place = 0.01;                       // of it against the camera, constant [m]
  double unknown_velocity = 0.3;                 // while bottom track is away [m/s]
  // Attitude: white noise, and the slowly varying error of its reference.
  double heading = 0.006, tilt = 0.002;  // of one reading [rad]
  double heading_lag = 0.1;              // of the compass's reading, while the vehicle turns [s]
  double deviation = 0.035;              // of the compass at first [rad]
  double deviation_drift = 7e-4;         // its random walk [rad/s^(1/2)]
  double deviation_turn = 0.017;  // its change with the heading: amplitude of 1.2 degrees [rad/rad^(1/2)]
  double tilt_bias = 0.009;       // of roll and pitch against the camera, at first [rad]
  // Its change with the heading: a bias that is the body's is reversed in nav by half a turn, so that the
  // reference has changed by 2 tilt_bias after pi radians [rad/rad^(1/2)].
  double tilt_turn = 0.010;
  double unknown_turn = 0.1;  // rate of turn while attitude is away [rad/s]
  double gyro_walk = 3e-4;    // angle random walk of a gyro, where there is one [rad/s^(1/2)]
  // Depth.
  double depth = 0.003;       // of one reading [m]
  double depth_offset = 0.1;  // of the sea's height over nav's zero, or of the sensor, at first [m]
  // Its rate at first, without a predicted tide (3 m twice a day: 0.3 mm/s rms); and beside it a random walk
  // of 4 mm in a minute (seiches, the sensor).
  double tide_rate = 3e-4, depth_drift = 5e-4;  // [m/s], [m/s^(1/2)]
  // Of all USBL positions of a mission together; unless it is 0, the shift is one position's standard
  // deviation at least. Shift: a ship's GPS without corrections (2 m), with its antenna's lever arm and a
  // degree of the transceiver's mounting over the 90 m to the vehicle (1.5 m). Turn: that mounting.
  double usbl_shift = 2.5, usbl_turn = 0.017;  // [m], [rad]
  // And for so long each errs alike with those before it: the sound's path, reflections, the ship's motion.
  double usbl_wander_s = 60;
  // Common error of scale of paths and turns of all visual links, which calibration and the lamps' shading
  // leave [1]. It does not average out, so covariances that are given out contain it.
  double visual_scale = 0.001;

  void validate() const;  // throws std::invalid_argument, which names the value that is out of range
};

// Heading of the vehicle, from north to east [rad]: where `forward`, its axis ahead in
// the camera's axes, points in plan. Well defined for every mounting of the camera, as
// a survey vehicle's axis ahead is never near the vertical; an axis of the image may
// be. kForward: of a camera that looks down with its image's upper edge ahead.
inline const Eigen::Vector3d kForward = {0, -1, 0};
[[nodiscard]] double headingOf(const SE3& T_odom_cam, const Eigen::Vector3d& forward);

// Every factor is a measured relative pose with pose_graph.hpp's residual e(T_from_to;
// T_w_from, T_w_to) and derivatives; directions that a sensor does not measure have next
// to no information (a standard deviation of 1000 km). Poses of the graph: cameras
// T_nav_cam, references T_nav_ref, and the origin of nav itself, however a graph names it
// (`origin`: measurements.hpp's kWorld, or a pose that is held). nav is North-East-Down.

// Circumstances of dead reckoning between two poses.
struct StepQuality {
  double seconds = 0;            // between them
  double seconds_unlocked = 0;   // of that, without bottom track
  double seconds_untilted = 0;   // of that, without attitude
  double calibration_share = 0;  // remaining standard deviation of DVL scale and heading [1], [rad]
  double turn = 0;               // between them [rad]
  double pressure_sigma = 0;     // standard deviation that swell gives a depth by pressure [m]
};

// By which a vehicle changes its velocity at most [m/s2].
inline constexpr double kMostAcceleration = 0.1;

// During a loss of bottom track the unmeasured velocity is one for all steps, so the error of the path grows
// with time, not with its root: a step adds the variance that the loss gains from T to T + dt,
//   v^2 ((T + dt)^2 - T^2),
// that of as many seconds as add() returns for the `unlocked_s` of the next step [s].
class LossOfTrack {
 public:
  double add(double unlocked_s);

  static void exchange(auto& archive, auto& self) { archive(self.lasted_s_); }

 private:
  double lasted_s_ = 0;
};

// DVL, integrated by dead reckoning (nav::DeadReckoning: lever arm, mounting, sound speed):
//   e_xyz = R_m^T (R_a^T (t_b - t_a) - t_m) + e_phi x l,   T_m = T_odom_a^-1 T_odom_b,
// in the axes of b: the path of the DVL itself, which is at l in the camera's axes, so that an error of the
// compass at b does not swing the camera about it. Horizontal: white and correlated noise of the velocity
// over the time, calibration and heading noise over the path, the DVL's place over the turn. Vertical: loose
// as far as odometry's depth is the pressure sensor's, which depthFactor uses: the less, the larger the
// swell; then the tilt's bias over the path. Rotation: loose, as it is the compass's, which attitudeFactor
// uses. Standard deviation of a step of that path, horizontal [m].
[[nodiscard]] double stepSigma(double path, const StepQuality& quality, const SensorNoise& noise);
// And by the correlated error of its velocity (horizontal, of either component) [m]: with v = path / T, w and
// tau of SensorNoise, variance 2 (w v)^2 tau T, the integral of a Gauss-Markov process over many tau. A chain
// of steps that are shorter than tau, each by itself, then errs in all as it should.
[[nodiscard]] double wanderSigma(double path, double seconds, const SensorNoise& noise);
[[nodiscard]] RelativePose stepFactor(int a, int b, const SE3& T_odom_a, const SE3& T_odom_b,
                                      const Eigen::Vector3d& dvl_in_camera, const StepQuality& quality,
                                      const SensorNoise& noise);
// Covariance or Jacobian of a perturbation (rho, phi) of a camera, to that of a point at `place` in its axes.
[[nodiscard]] Matrix6d perturbationAt(const Eigen::Vector3d& place);

// Attitude of a camera against a reference. Its rotation R_nav_ref is the slowly varying error of the sensor:
// deviation about z, bias of roll and pitch about x and y:
//   e_phi = vec(R_odom_cam^T R_nav_ref^T R_nav_cam).
[[nodiscard]] RelativePose attitudeFactor(int reference, int camera, const SE3& T_odom_cam,
                                          const SensorNoise& noise);

// What a compass reads beyond its mean over the path to here, as a gyro carries it: what the seafloor's own
// field does to it, beside a deviation that is another there [rad]; and the time of that path [s], 0: no
// gyro.
struct CompassOff {
  double beyond_mean = 0, seconds = 0;
};

// Standard deviation of a gyro's bias before anything is known of it [rad/s].
inline constexpr double kGyroBias = 1e-3;

// The first reference: R_nav_ref is about identity, with the deviation and bias that are usual. Its heading
// is a mean of two, the compass's here and the one carried here, by their variances: s^2 the deviation's, o
// beyond the mean, d what the bias makes of half the path,
//   here s^2 + max(0, o^2 - d^2),   carried s^2 + d^2 + (o / 4)^2,
// the last as the path ends in the same field.
[[nodiscard]] RelativePose firstAttitudeReference(int origin, int reference, const CompassOff& off,
                                                  const SensorNoise& noise);
// The next one, `seconds` later and after turning by `turn` [rad]: a random walk of the error,
//   e_phi = vec(R_nav_before^T R_nav_after). `extra`: further standard deviation of heading [rad].
// tiltAbout: what keeps the walk of the tilt near zero, however often the vehicle turns. In a chain whose
// steps have the variance q, poses have the variance s^2 where each has the information
//   l = sqrt(4 / q^2 + 1 / s^4) - 2 / q;
// s^2 = 2 tilt_bias^2, so that after half a turn, which reverses the body's bias, the difference has 4.
[[nodiscard]] RelativePose attitudeDrift(int before, int after, double seconds, double turn, double extra,
                                         const SensorNoise& noise);
[[nodiscard]] RelativePose tiltAbout(int origin, int reference, double turn, const SensorNoise& noise);

// Turn of a camera about nav's down axis by gyro, which differs from the compass's by `beyond` [rad]:
//   e_phi along R_nav_b^T n of T_m = T_odom_a^-1 Rz(beyond) T_odom_b about the camera, n down.
// `sigma`: of the turn [rad]; `tilt_sigma`: of what it turned about level axes, loosely, as attitude measures
// that. Without it the turn's narrow valley bends through all tilts, and a pose whose attitude does not count
// may come to rest in it upside down.
[[nodiscard]] RelativePose gyroFactor(int a, int b, const SE3& T_odom_a, const SE3& T_odom_b, double beyond,
                                      double sigma, double tilt_sigma);

// Depth of a camera below a level reference T_nav_ref, at the height of the sea under nav's zero (the origin:
// 0):  e_z = n . R_m (R_m^T (T_nav_ref^-1 t_nav_cam - t_odom_cam)), n down. `sigma`: of the depth of
// t_odom_cam [m].
[[nodiscard]] RelativePose depthFactor(int reference, int camera, const SE3& T_odom_cam, double sigma);

// The height of the sea under nav's zero and its rate, as a pose T_nav_tide: its z is the height, and time
// runs along its x axis, a metre a minute, so that the axis's slope is the rate. Over `seconds` it is
// extrapolated, and the rate changes as a tide's does:
//   T_before_after = (minutes, 0, walk; 0, walk of the rate, 0).
[[nodiscard]] RelativePose firstTide(int origin, int tide, const SensorNoise& noise);
[[nodiscard]] RelativePose tideStep(int before, int after, double seconds, const SensorNoise& noise);
[[nodiscard]] double tideRate(const SE3& T_nav_tide);  // [m/s]
// The reference of depth at that height; and that it is level, as a slope of it would be one of the sea.
[[nodiscard]] RelativePose depthAtTide(int tide, int reference);
[[nodiscard]] RelativePose levelReference(int origin, int reference);

// Standard deviation that a USBL's position counts with, `since_s` after the one before it, so that the mean
// of many has the variance that it has when each errs alike with the last (a Gauss-Markov process; Bayley &
// Hammersley 1946, effective number of independent observations): with rho = exp(-since / usbl_wander_s)
//   s^2 (1 + rho) / (1 - rho),
// `since_s` half of that time at most, as the sound's path stays nearly the same. Otherwise positions at ten
// seconds by a reflection turn a survey of a few metres about.
[[nodiscard]] double usblSigma(double sigma, double since_s, const SensorNoise& noise);
// The same for the positions of a dive as they come.
class UsblWander {
 public:
  double add(std::int64_t utc_ns, double sigma, const SensorNoise& noise);

  static void exchange(auto& archive, auto& self) { archive.instants(self.last_ns_); }

 private:
  std::int64_t last_ns_ = 0;
};
// Where the positions of a USBL are in nav, about `T_nav_usbl`. `sigma`: of one position [m].
[[nodiscard]] double usblShift(double sigma, const SensorNoise& noise);
[[nodiscard]] RelativePose usblFrame(int origin, int usbl, const SE3& T_nav_usbl, double sigma,
                                     const SensorNoise& noise);

// A position fix (USBL, GPS) of an antenna that odometry has at
// `antenna_in_odom`, perhaps at another time: the camera is where the fix is,
// less the path between them as odometry has it, turned by the present estimate:
//   l = R_odom_cam^T (antenna - t_odom_cam),   t_m = fix - R_nav_cam l,
//   e = R_m^T (t_nav_cam - t_m) + e_phi x l, horizontal,
// so that it holds to the second order when later estimates turn the
// camera. `sigma`: of either component [m].
[[nodiscard]] RelativePose fixFactor(int origin, int camera, const SE3& T_nav_cam, const SE3& T_odom_cam,
                                     const Eigen::Vector3d& antenna_in_odom, const Eigen::Vector2d& fix,
                                     double sigma);

// The same by a USBL: of the camera in the USBL's frame, `T_nav_usbl` at
// first and `T_nav_now` by the present estimate.
[[nodiscard]] RelativePose usblFixFactor(int usbl, int camera, const SE3& T_nav_usbl, const SE3& T_nav_now,
                                         const SE3& T_nav_cam, const SE3& T_odom_cam,
                                         const Eigen::Vector3d& antenna_in_odom, const Eigen::Vector2d& fix,
                                         double sigma);

// Visual odometry or a loop closure: T_a_b with the covariance of its right perturbation (rho, phi).
[[nodiscard]] RelativePose linkFactor(int a, int b, const SE3& T_a_b, const Matrix6d& covariance);

// Robust weight of a factor that may be an outlier: 1 up to `free`, beyond as by Cauchy's kernel, so that its
// influence is bounded. And `free` at 95 %: chi-square with 6 (links) and 2 (fixes) degrees of freedom.
inline constexpr double kLinkFree = 12.59, kFixFree = 5.99;
[[nodiscard]] inline double cauchyWeight(double chi2, double free) {
  return chi2 <= free ? 1 : free / chi2;
}

}  // namespace fathom::slam
