
#include "realtime/base/input_error.hpp"
#include "recon/solver/pose_graph.hpp"

using namespace fathom;

// Any bytes as a pose graph.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const slam::PoseGraph graph =
        slam::parseG2o(std::string_view(reinterpret_cast<const char*>(data), size), "graph.g2o");
    for (const slam::RelativePose& e : graph.edges) {
      const auto poses = static_cast<int>(graph.poses.size());
      if (e.from < 0 || e.to < 0 || e.from >= poses || e.to >= poses) __builtin_trap();
    }
  } catch (const InputError&) {
  }
  return 0;
}
