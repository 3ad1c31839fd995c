#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "realtime/base/bytes/state_archive_fwd.hpp"
#include "recon/geometry/camera.hpp"
#include "recon/geometry/se3.hpp"

namespace fathom::closure {

// Footprint of a frame on the seafloor, in plan: a disc about the intersection of the principal ray.
struct Footprint {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  // north, east [m]
  double radius = 0;                                 // [m]
};

// `range`: along the principal ray [m]. The disc has the area that the image covers there: radius
// range sqrt(w h / (pi fx fy)).
[[nodiscard]] Footprint footprintOf(const SE3& T_nav_cam, double range, const Camera& camera);
// Range along the principal ray to level ground `altitude` below the camera [m]; off-vertical
// angles beyond 78 degrees count as 78.
[[nodiscard]] double rangeToLevelGround(const SE3& T_nav_cam, double altitude);

// Separation of two equal discs of radius 1 that share the given part of their area, 0 to 1.
[[nodiscard]] double separationOfOverlap(double share);

// Probability that the separation d ~ N(mean, covariance) [m, m^2] is at most `reach` [m]:
//   P = int_{|d| <= reach} N(d; mean, covariance) dd,
// along the principal axes of the covariance: 32 nodes of Gauss-Legendre over the wider one, the error
// function over the narrower, to 0.01 where the disc's border is sharp (Mahon et al. 2008: loop-closure
// hypotheses under the uncertainty of the relative position).
[[nodiscard]] double overlapProbability(const Eigen::Vector2d& mean, const Eigen::Matrix2d& covariance,
                                        double reach);

// Information of a measurement of the separation with the standard deviation `sigma` [m], in nat:
//   I = 1/2 log det (1 + covariance / sigma^2),
// the mutual information of measurement and state (Eustice et al. 2006; Ila et al. 2010).
[[nodiscard]] double expectedInformation(const Eigen::Matrix2d& covariance, double sigma);

struct CandidateConfig {
  double min_overlap = 0.3;      // share of the smaller footprint
  double sigma_measured = 0.02;  // of a registration, horizontal [m]
  double min_information = 0.7;  // [nat]; 0.7: the separation is as uncertain as the registration
  std::size_t capacity = 1000;   // pairs in the queue
};

struct Candidate {
  std::uint32_t older = 0, newer = 0;  // indices of frames
  double probability = 0;              // of the overlap
  double information = 0;              // [nat]
  [[nodiscard]] double value() const { return probability * information; }

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.older, self.newer, self.probability, self.information);
  }
};

// The candidate of a pair, from the covariance of the separation of its footprints [m^2]. Discs of different
// size overlap as two of their mean radius. `apart`: separationOfOverlap(config.min_overlap), computed once
// by the caller because it takes longer than the rest.
[[nodiscard]] Candidate candidateOf(std::uint32_t older, const Footprint& there, std::uint32_t newer,
                                    const Footprint& here, const Eigen::Matrix2d& covariance,
                                    const CandidateConfig& config, double apart);

// Pairs of frames to register, those of the greatest expected information (probability times information of a
// registration) first. Bounded: when full, the pair of least value is dropped and counted.
class CandidateQueue {
 public:
  explicit CandidateQueue(const CandidateConfig& config);

  void push(const Candidate& candidate);

  // Takes out the pair of greatest value; of equals the newest. False when empty.
  [[nodiscard]] bool pop(Candidate& candidate);
  void clear() { waiting_.clear(); }

  [[nodiscard]] std::size_t size() const { return waiting_.size(); }
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }  // pairs dropped when full

  // Saved state (state_archive.hpp); pairs of frames below `frames`.
  void save(rt::StateWriter& writer) const;
  [[nodiscard]] bool load(rt::StateReader& reader, std::size_t frames);

 private:
  CandidateConfig config_;
  std::vector<Candidate> waiting_;  // by value, the best last
  std::uint64_t dropped_ = 0;
};

}  // namespace fathom::closure
