// Made dives on which sensors lie: how far the position errs, against a solution that knows which data lie.
#include <algorithm>
#include <cstdio>

#include "tests/bench/reports.hpp"
#include "tests/slam/hostile_dives.hpp"

namespace fathom::bench {
namespace {

struct Options {
  int seeds = 20;
  std::string only;
};

int run(const Options& o) {
  using slam::testing::runHostile;
  constexpr double kLost = 10;  // [m]
  constexpr double kTwice = 2;  // times the error of the solution that was told
  std::printf(
      "runs beyond 10 m, beyond twice the error of a solution that was told; worst error (when told)\n");
  std::printf("%-44s %-27s %-27s %s\n", "", "on board, live", "on board, after", "topside");
  int lost = 0, runs = 0;
  for (const auto& dive : slam::testing::hostileDives()) {
    if (dive.name.find(o.only) == std::string::npos) continue;
    int beyond[3] = {}, twice[3] = {};
    double worst[3] = {}, told[3] = {};
    for (int seed = 1; seed <= o.seeds; ++seed) {
      const auto [e, t] = runHostile(dive, static_cast<std::uint64_t>(seed));
      const double errors[3] = {e.live, e.after, e.topside}, best[3] = {t.live, t.after, t.topside};
      for (int i = 0; i < 3; ++i) {
        beyond[i] += errors[i] > kLost ? 1 : 0;
        twice[i] += errors[i] > kTwice * best[i] ? 1 : 0;
        worst[i] = std::max(worst[i], errors[i]);
        told[i] = std::max(told[i], best[i]);
        lost += errors[i] > kLost ? 1 : 0;
        ++runs;
      }
    }
    std::printf("%-44s", dive.name.c_str());
    for (int i = 0; i < 3; ++i)
      std::printf(" %3d %3d %8.2f (%5.2f) m ", beyond[i], twice[i], worst[i], told[i]);
    std::printf("\n");
    std::fflush(stdout);
  }
  std::printf("%d of %d runs beyond %.0f m\n", lost, runs, kLost);
  return lost == 0 ? 0 : 1;
}

}  // namespace

test::Report hostileReport() {
  static Options o;
  return {"hostile",
          "How far positions err on made dives whose sensors lie",
          {{"--seeds", &o.seeds, "runs of each dive", 1, 1000},
           {"--only", &o.only, "dives whose names hold this"}},
          [] { return run(o); }};
}

}  // namespace fathom::bench
