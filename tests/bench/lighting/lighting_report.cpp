// What lighting correction does to a simulated mission: brightness steps between overlapping images, stereo
// matches in the outer third, which model was chosen, and pictures. README.md of recon/lighting quotes it.
#include <algorithm>
#include <cstdio>

#include "realtime/kernel/input_error.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/lighting/brightness_steps.hpp"
#include "tests/bench/lighting/match_counts.hpp"
#include "tests/bench/lighting/strip.hpp"
#include "tests/bench/reports.hpp"

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

std::size_t steepest(const TrueMission& mission, std::size_t frames) {
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
  const TrueMission mission(o.mission);
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
    const io::ImageFile left = mission.image(k, CameraSide::kLeft);
    const CorrectedPair pair =
        corrections.correct(left, mission.image(k, CameraSide::kRight), mission.pairs()[k].plane);
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
  Page page("Lighting correction of " + o.mission.filename().string());
  for (int n = 0; n < kNeighbours; ++n) {
    Table table{kNeighbourNames[static_cast<std::size_t>(n)],
                {{"", 0}, {"step", 4}, {"down by", 2}, {"jump", 4}, {"jump down by", 2}, {"patches", 0}},
                {}};
    const BrightnessStep raw = steps.result(Corrections::kRaw, static_cast<Neighbour>(n));
    for (int k = 0; k < Corrections::kCount; ++k)
      if (const BrightnessStep s = steps.result(k, static_cast<Neighbour>(n)); s.patches > 0)
        table.rows.push_back(
            {Corrections::name(k), s.step, raw.step / s.step, s.jump, raw.jump / s.jump, cell(s.patches)});
    page.add(std::move(table));
  }
  Table table{"stereo matches of " + std::to_string(matches.pairs()) + " pairs",
              {{"", 0},
               {"all", 0},
               {"outer", 0},
               {"correct", 0},
               {"times raw", 2},
               {"peer: all", 0},
               {"peer: correct", 0},
               {"peer: times raw", 2}},
              {}};
  const MatchCounts::Count& raw = matches.count(Corrections::kRaw);
  const auto ratio = [](std::size_t a, std::size_t b) {
    return static_cast<double>(a) / static_cast<double>(std::max<std::size_t>(1, b));
  };
  for (int k = 0; k < Corrections::kCount; ++k) {
    const MatchCounts::Count& c = matches.count(k);
    table.rows.push_back({Corrections::name(k), cell(c.all), cell(c.outer), cell(c.correct_outer),
                          ratio(c.correct_outer, raw.correct_outer), cell(c.peer_all),
                          cell(c.peer_correct_outer), ratio(c.peer_correct_outer, raw.peer_correct_outer)});
  }
  page.add(std::move(table));
  for (const char* picture : {"strip.png", "pair.png"}) page.report().pictureFile(o.out / picture, picture);
  std::printf("\n%s", page.text().c_str());
  page.write(o.out, "lighting");
  return kExitSuccess;
}

}  // namespace

test::Report lightingReport() {
  static Options o;
  return {"lighting",
          "What lighting correction does to a simulated mission",
          {required({"mission", &o.mission, "mission folder with truth"}),
           required({"--out", &o.out, "folder for the pictures, lighting.html and lighting.json"}),
           {"--learn", &o.learn, "pairs to learn from"},
           {"--images", &o.images, "images whose patches are compared"},
           {"--matches", &o.matches, "pairs whose matches are counted"},
           {"--features", &o.features, "corners wanted in an image"},
           {"--frames", &o.frames, "frames of the strip"},
           {"--first", &o.first, "first frame of the strip; 0: where the altitude changes most"}},
          [] { return run(o); }};
}

}  // namespace fathom::bench
