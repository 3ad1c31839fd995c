// What lighting correction does to a simulated mission: brightness steps between overlapping images, stereo
// matches in the outer third, which model was chosen, and pictures. README.md of recon/lighting quotes it.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "realtime/kernel/input_error.hpp"
#include "tests/bench/lighting/brightness_steps.hpp"
#include "tests/bench/lighting/match_counts.hpp"
#include "tests/bench/lighting/one_image.hpp"
#include "tests/bench/lighting/strip.hpp"

namespace fathom::bench {
namespace {

struct Options {
  std::filesystem::path mission, out;
  std::size_t learn = 100;   // pairs, as fathom-topside's default
  std::size_t images = 60;   // with patches
  std::size_t matches = 40;  // pairs whose matches are counted
  int features = 800;        // corners wanted, an image
  std::size_t frames = 8;    // of the strip
  std::size_t first = 0;     // frame of the strip; 0: where the altitude changes most
};

std::size_t steepest(const ReportMission& mission, std::size_t frames) {
  std::size_t best = 0;
  double most = -1;
  for (std::size_t k = 0; k + frames < mission.pairs().size(); ++k) {
    const double change =
        std::abs(mission.pairs()[k + frames].plane.distance - mission.pairs()[k].plane.distance);
    if (change > most) most = change, best = k;
  }
  return best;
}

int run(Options o) {
  if (std::filesystem::is_regular_file(o.mission)) {
    std::filesystem::create_directories(o.out);
    correctOneImage(o.mission, o.out / "one_image.png");
    return kExitSuccess;
  }
  const ReportMission mission(o.mission);
  const std::size_t all = mission.pairs().size();
  std::filesystem::create_directories(o.out);
  Corrections corrections(mission, o.learn);
  BrightnessSteps steps(mission, o.images);
  MatchCounts matches(mission, o.features);
  Strip strip(mission, {Corrections::kRaw, Corrections::kReference, Corrections::kPlain, Corrections::kAuto});
  if (o.first == 0) o.first = steepest(mission, o.frames);

  std::vector<bool> patches(all);
  for (const std::size_t image : steps.images()) patches[image] = true;
  const std::size_t every = std::max<std::size_t>(1, all / std::max<std::size_t>(o.matches, 1));
  for (std::size_t k = 0; k < all; ++k) {
    const bool in_strip = k >= o.first && k < o.first + o.frames;
    if (!patches[k] && k % every != 0 && !in_strip) continue;
    const io::ImageFile left = mission.left(k);
    const CorrectedPair pair = corrections.correct(left, mission.right(k), mission.pairs()[k].plane);
    if (patches[k]) steps.measure(k, left.view, pair);
    if (k % every == 0) matches.measure(k, pair);
    if (in_strip) strip.add(pair);
    if (k == o.first + o.frames / 2)
      Strip::writePair(mission, pair, Corrections::kRaw, Corrections::kAuto, o.out / "pair.png");
  }
  strip.write(o.out / "strip.png");

  const auto report = corrections.report(Corrections::kAuto);
  std::printf(
      "%s: %zu pairs, learnt from %d; automatic: %s (foretelling errors: whole %.3f, plain %.3f, range "
      "%.3f)\n",
      o.mission.c_str(), all, report.images, nameOf(report.used), report.error_whole, report.error_plain,
      report.error_range);
  nlohmann::ordered_json json = {{"mission", o.mission.string()}, {"automatic", nameOf(report.used)}};
  for (int n = 0; n < kNeighbours; ++n) {
    std::printf("\n%-20s %9s %9s %9s %9s\n", kNeighbourNames[static_cast<std::size_t>(n)], "step", "down by",
                "jump", "down by");
    const BrightnessStep raw = steps.result(Corrections::kRaw, static_cast<Neighbour>(n));
    for (int k = 0; k < Corrections::kCount; ++k) {
      const BrightnessStep s = steps.result(k, static_cast<Neighbour>(n));
      if (s.patches == 0) continue;
      std::printf("  %-18s %9.4f %9.2f %9.4f %9.2f   (%zu patches)\n", Corrections::name(k), s.step,
                  raw.step / s.step, s.jump, raw.jump / s.jump, s.patches);
      json["steps"][kNeighbourNames[static_cast<std::size_t>(n)]][Corrections::name(k)] = {
          {"step", s.step},
          {"step_down_by", raw.step / s.step},
          {"jump", s.jump},
          {"jump_down_by", raw.jump / s.jump},
          {"patches", s.patches}};
    }
  }
  std::printf("\n%-20s %9s %9s %9s %9s | %9s %9s %9s   (%zu pairs)\n", "stereo matches", "all", "outer",
              "correct", "times raw", "peer: all", "correct", "times raw", matches.pairs());
  const MatchCounts::Count& raw = matches.count(Corrections::kRaw);
  const auto ratio = [](std::size_t a, std::size_t b) {
    return static_cast<double>(a) / static_cast<double>(std::max<std::size_t>(1, b));
  };
  for (int k = 0; k < Corrections::kCount; ++k) {
    const MatchCounts::Count& c = matches.count(k);
    const double times = ratio(c.correct_outer, raw.correct_outer);
    const double peer_times = ratio(c.peer_correct_outer, raw.peer_correct_outer);
    std::printf("  %-18s %9zu %9zu %9zu %9.2f | %9zu %9zu %9.2f\n", Corrections::name(k), c.all, c.outer,
                c.correct_outer, times, c.peer_all, c.peer_correct_outer, peer_times);
    json["matches"][Corrections::name(k)] = {{"all", c.all},
                                             {"outer", c.outer},
                                             {"correct_outer", c.correct_outer},
                                             {"times_raw", times},
                                             {"peer_all", c.peer_all},
                                             {"peer_correct_outer", c.peer_correct_outer},
                                             {"peer_times_raw", peer_times}};
  }
  std::ofstream(o.out / "lighting.json") << json.dump(2) << "\n";
  return kExitSuccess;
}

}  // namespace
}  // namespace fathom::bench

int main(int argc, char** argv) {
  CLI::App app{"what lighting correction does to a simulated mission"};
  fathom::bench::Options o;
  app.add_option("mission", o.mission, "mission folder with truth, or a single image")->required();
  app.add_option("--out", o.out, "folder for the pictures and lighting.json")->required();
  app.add_option("--learn", o.learn, "pairs to learn from")->capture_default_str();
  app.add_option("--images", o.images, "images whose patches are compared")->capture_default_str();
  app.add_option("--matches", o.matches, "pairs whose matches are counted")->capture_default_str();
  app.add_option("--features", o.features, "corners wanted in an image")->capture_default_str();
  app.add_option("--frames", o.frames, "frames of the strip")->capture_default_str();
  app.add_option("--first", o.first, "first frame of the strip; 0: where the altitude changes most");
  CLI11_PARSE(app, argc, argv);
  return fathom::runTool("report_lighting", [&] { return fathom::bench::run(o); });
}
