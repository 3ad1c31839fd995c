#pragma once

#include <array>
#include <cstdint>
#include <set>
#include <utility>
#include <vector>

#include "recon/closure/registration.hpp"
#include "recon/slam/navigation_batch.hpp"
#include "recon/topside/stages/feature_stage.hpp"

namespace fathom::topside {

// One pair of frames to register, and what came of it.
struct Attempt {
  std::uint32_t a = 0, b = 0;
  closure::RelativePrior prior;
  closure::Registration result;
};

// Visual odometry: links between consecutive frames, with dead reckoning as prior; where that is contradicted
// (a compass that leapt, a DVL that lies or was silent), once more with a wide prior and the stricter rules
// of closures. The result does not depend on the number of threads.
[[nodiscard]] std::vector<slam::NavigationLink> visualOdometry(const StereoRig& rig, const Frames& frames);

// Looks for loop closures in rounds: each round's solution says where the next one looks.
class ClosureSearch {
 public:
  ClosureSearch(const StereoRig& rig, const Frames& frames) : rig_(rig), frames_(frames) {}

  // The most valuable candidates, at most `most`, that were not tried before: pairs whose footprints overlap
  // with some probability under the uncertainty of the solution, which is that of its graph, or the growth of
  // `drift` with the way where that is less. In the order of their worth.
  [[nodiscard]] std::vector<Attempt> candidates(const slam::NavigationSolution& solution, double drift,
                                                std::size_t most);
  // Registers them all. Accepted ones as links.
  std::vector<slam::NavigationLink> attempt(std::vector<Attempt>& attempts);

  [[nodiscard]] const std::array<std::size_t, closure::kRefusals>& refused() const { return refused_; }

 private:
  const StereoRig& rig_;
  const Frames& frames_;
  std::set<std::pair<std::uint32_t, std::uint32_t>> tried_;
  std::array<std::size_t, closure::kRefusals> refused_{};
};

}  // namespace fathom::topside
