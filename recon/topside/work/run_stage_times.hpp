#pragma once

#include <time.h>

#include <array>
#include <chrono>
#include <cstddef>

namespace fathom::topside {

// What a pair costs, by stage; seconds of one thread.
enum class PairStage : std::size_t { kRead, kLighting, kFeatures, kStereo, kMesh, kFusion };
inline constexpr std::size_t kPairStages = 6;
inline constexpr std::array<const char*, kPairStages> kPairStageNames = {"read",   "lighting", "features",
                                                                         "stereo", "mesh",     "fusion"};

struct PairTimes {
  std::array<double, kPairStages> seconds{};
  double& operator[](PairStage stage) { return seconds[static_cast<std::size_t>(stage)]; }
  PairTimes& operator+=(const PairTimes& other) {
    for (std::size_t k = 0; k < kPairStages; ++k) seconds[k] += other.seconds[k];
    return *this;
  }
};

class Stopwatch {
 public:
  // Seconds since construction or the last lap.
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    const double seconds = std::chrono::duration<double>(now - begun_).count();
    begun_ = now;
    return seconds;
  }

 private:
  std::chrono::steady_clock::time_point begun_ = std::chrono::steady_clock::now();
};

// Processor seconds of the calling thread since construction or the last lap: what work costs, however many
// others are at work.
class ThreadStopwatch {
 public:
  double lap() {
    const double now = seconds();
    const double lap = now - begun_;
    begun_ = now;
    return lap;
  }

 private:
  static double seconds() {
    timespec now{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }
  double begun_ = seconds();
};

}  // namespace fathom::topside
