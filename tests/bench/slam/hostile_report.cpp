// Synthetic dives with false sensor data: position error, against a solution without the false data.
#include <algorithm>
#include <cstdio>

#include "tests/bench/reports.hpp"
#include "tests/navigation/hostile_dives.hpp"

namespace fathom::bench {
namespace {

struct HostileOptions {
  int seeds = 20;
  std::string only;
};

int runHostile(const HostileOptions& o) {
  using slam::testing::runHostile;
  constexpr double kLost = 10;  // [m]
  constexpr double kWorse = 2;  // times the error of the solution without the false data
  std::printf(
      "runs beyond 10 m, beyond twice the error without the false data; worst error (without the false "
      "data)\n");
  std::printf("%-44s %-27s %-27s %s\n", "", "on board, live", "on board, after", "topside");
  int lost = 0, runs = 0;
  for (const auto& dive : slam::testing::hostileDives()) {
    if (dive.name.find(o.only) == std::string::npos) continue;
    int beyond[3] = {}, worse[3] = {};
    double worst[3] = {}, clean[3] = {};
    for (int seed = 1; seed <= o.seeds; ++seed) {
      const auto [e, t] = runHostile(dive, static_cast<std::uint64_t>(seed));
      const double errors[3] = {e.live, e.after, e.topside}, best[3] = {t.live, t.after, t.topside};
      for (int i = 0; i < 3; ++i) {
        beyond[i] += errors[i] > kLost ? 1 : 0;
        worse[i] += errors[i] > kWorse * best[i] ? 1 : 0;
        worst[i] = std::max(worst[i], errors[i]);
        clean[i] = std::max(clean[i], best[i]);
        lost += errors[i] > kLost ? 1 : 0;
        ++runs;
      }
    }
    std::printf("%-44s", dive.name.c_str());
    for (int i = 0; i < 3; ++i)
      std::printf(" %3d %3d %8.2f (%5.2f) m ", beyond[i], worse[i], worst[i], clean[i]);
    std::printf("\n");
    std::fflush(stdout);
  }
  std::printf("%d of %d runs beyond %.0f m\n", lost, runs, kLost);
  return lost == 0 ? 0 : 1;
}

}  // namespace

test::Report hostileReport() {
  static HostileOptions o;
  return {"hostile",
          "Position error on synthetic dives with false sensor data",
          {{"--seeds", &o.seeds, "runs of each dive", 1, 1000},
           {"--only", &o.only, "dives with this in their name"}},
          [] { return runHostile(o); }};
}

}  // namespace fathom::bench
