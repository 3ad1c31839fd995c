#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "recon/navigation/gating/fix_gate.hpp"
#include "recon/navigation/gating/step_gate.hpp"

namespace fathom::slam {

// kAgreed: a closure that others agree with around a cycle, whatever the graph says.
enum class LinkKind : std::uint8_t { kOdometry, kClosure, kAgreed };

// Gate of visual links: those of the chain wait for StepGate; closures must agree with what the graph
// predicts, or with so many closures that contradicted it that the graph must be wrong.
class LinkGate {
 public:
  LinkGate(KeyframeStore& keyframes, DvlCalibration& dvl, SharedTurns& turns, RobustFactors& robust,
           FixGate& fixes, StepGate& steps, SensorReferences& references);

  // NavigationGraph::addLink().
  Taken add(LinkKind kind, int a, int b, const SE3& seen, const Matrix6d& covariance, bool confirmed);
  [[nodiscard]] std::size_t memoryBytes() const { return displaced_.capacity() * sizeof(int); }

  template <typename Archive, typename Self>
  static void exchange(Archive& archive, Self& self) {
    archive(self.rejected_, self.next_rejected_);
  }

 private:
  struct Rejected {  // a closure that contradicts the graph
    int a = -1, b = -1;
    UncertainPose link;

    template <typename Archive, typename Self>
    static void exchange(Archive& archive, Self& self) {
      archive(self.a, self.b, self.link.T_a_b, self.link.covariance);
    }
  };
  [[nodiscard]] bool agreesWithRejected(int a, int b, const UncertainPose& link);
  void displaceLost(int a, int b, const SE3& T_a_b);

  KeyframeStore& keyframes_;
  DvlCalibration& dvl_;
  SharedTurns& turns_;
  RobustFactors& robust_;
  FixGate& fixes_;
  StepGate& steps_;
  SensorReferences& references_;
  std::vector<int> displaced_;         // nodes
  std::array<Rejected, 16> rejected_;  // the newest, in turn
  std::uint64_t next_rejected_ = 0;
};

}  // namespace fathom::slam
