#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "recon/navigation/graph/keyframe_store.hpp"
#include "recon/solver/matrix_state.hpp"

namespace fathom::slam {

class SharedTurns;

// A link or a fix that was accepted, with its robust weight.
struct RobustFactor {
  int from = kWorld, to = 0;  // nodes
  SE3 T_from_to;
  Matrix6d spread;  // a link's covariance, of which its information follows; a fix's information
  int measurement = 0;
  double free_chi2 = 0;  // up to there its weight is 1
  double weight = 1;
  bool fix = false, off = false;
  bool confirmed = false;                                     // independently, by others: its weight stays 1
  Eigen::Vector4d straightened_by = Eigen::Vector4d::Zero();  // DvlCalibration::curl() taken out of a link
  int curl_epoch = 0;                                         // SharedTurns::curlEpoch() when it was seen

  [[nodiscard]] RelativePose factor() const {
    return fix ? RelativePose{from, to, T_from_to, spread} : linkFactor(from, to, T_from_to, spread);
  }

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.from, self.to, self.T_from_to, self.measurement, self.free_chi2, self.weight, self.fix,
            self.off, self.confirmed, self.straightened_by, self.curl_epoch);
    exchangeSymmetric(archive, self.spread);
  }
};

// The links between keyframes that are not neighbours, closures among them,
// and the fixes of a navigation graph: Cauchy's weight by their residuals,
// which switches off what the rest contradicts and on again. Fixed memory.
class RobustFactors {
 public:
  explicit RobustFactors(KeyframeStore& keyframes);

  [[nodiscard]] bool isFull() const { return factors_.size() == factors_.capacity(); }
  // Fewer than `spare` places are free.
  [[nodiscard]] bool isShort(std::size_t spare) const;
  [[nodiscard]] bool has(int measurement) const { return place_of_[at(measurement)] >= 0; }
  [[nodiscard]] std::span<const RobustFactor> all() const { return factors_; }
  void add(const RobustFactor& factor);
  // Its measurement in the solver is another from now on.
  void replaceMeasurement(RobustFactor& factor, int measurement);
  // The measurement went with a pose.
  void forget(int measurement);

  // Weights of the newest factors and of some older ones in turn. A factor is switched off only by poses
  // that are at rest (`settled`), and on again when it would pass the gate of a new one.
  void reweight(bool settled, SharedTurns& turns);

  // For saved state; then rebuildIndices(): false if an index is invalid or used twice.
  template <typename Archive, typename Self>
  static void exchangeTurn(Archive& archive, Self& self) {
    archive(self.next_, self.newest_);
  }
  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive.bounded(self.factors_, self.factors_.capacity());
  }
  [[nodiscard]] bool rebuildIndices();
  [[nodiscard]] std::size_t memoryBytes() const {
    return factors_.capacity() * sizeof(RobustFactor) + place_of_.size() * sizeof(int);
  }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  void reweight(RobustFactor& factor, bool settled, SharedTurns& turns);
  [[nodiscard]] bool passesGate(const RobustFactor& factor, SharedTurns& turns) const;
  void move(std::size_t from, std::size_t to);

  KeyframeStore& keyframes_;
  std::vector<RobustFactor> factors_;
  std::vector<int> place_of_;  // of a measurement, in factors_; -1: none
  // The one to be looked at next, and the first of those that have not been looked at yet.
  std::size_t next_ = 0, newest_ = 0;
};

}  // namespace fathom::slam
