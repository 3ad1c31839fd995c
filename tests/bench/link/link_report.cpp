// Measures the link: frames sent until a set of tiles is complete, a survey over a slow link, a ship that was
// switched off.
#include <cmath>
#include <cstdio>

#include "realtime/kernel/input_error.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/link/reliability.hpp"
#include "tests/bench/link/survey.hpp"
#include "tests/bench/reports.hpp"

namespace fathom::bench {
namespace {

Table reliability(int seeds) {
  Table table{"Frames until 99 % of the blocks are there",
              {{"acknowledged", 0},
               {"mean burst", 0},
               {"loss", 1},
               {"packets", 0},
               {"bound", 3},
               {"mean frames", 3},
               {"standard error", 3},
               {"ratio", 3},
               {"p95 ratio", 3},
               {"finished", 3},
               {"complete", 3}},
              {}};
  for (const bool feedback : {true, false})
    for (const double burst : {0.0, 5.0})
      for (const double loss : {0.1, 0.3, 0.5}) {
        const ReliabilityResult r = measureReliability({loss, burst, feedback, seeds});
        table.rows.push_back({feedback ? "yes" : "no", burst, loss, cell(r.packets), r.bound, r.mean_frames,
                              r.standard_error, r.mean_frames / r.bound, r.p95_frames / r.bound,
                              r.finished_share, r.mean_complete});
      }
  return table;
}

// A row a figure, a column a scenario.
Table surveys(const std::string& name, const std::vector<std::string>& scenarios,
              const std::vector<SurveyResult>& results) {
  Table table{name, {{"", 0}}, {}};
  for (const std::string& scenario : scenarios) table.columns.push_back({scenario, 3});
  const auto add = [&](const char* what, const auto& figure) {
    table.rows.push_back({what});
    for (const SurveyResult& r : results) table.rows.back().push_back(cell(figure(r, r.counters)));
  };
  using R = SurveyResult;
  using C = telemetry::LinkScheduler::Counters;
  constexpr double kNever = 1e8;
  add("imaged [m2]", [](const R& r, const C&) { return r.imaged_m2; });
  add("judged [m2]", [](const R& r, const C&) { return r.judged_m2; });
  add("shown within 60 s", [](const R& r, const C&) { return r.in_time_share; });
  add("the same at any spacing", [](const R& r, const C&) { return r.coarse_in_time_share; });
  add("shown at the end", [](const R& r, const C&) { return r.shown_share; });
  add("latency p50 [s]", [](const R& r, const C&) { return r.p50_s; });
  add("latency p95 [s]", [](const R& r, const C&) { return r.p95_s < kNever ? r.p95_s : NAN; });
  add("largest error [m]", [](const R& r, const C&) { return r.max_error_m; });
  add("B/m2", [](const R& r, const C&) { return r.bytes_per_m2; });
  add("B a map frame", [](const R& r, const C&) { return r.bytes_per_map_frame; });
  add("blocks a map frame", [](const R& r, const C&) { return r.blocks_per_map_frame; });
  add("share not sending", [](const R& r, const C&) { return r.listening_share; });
  add("complete after [s]",
      [](const R& r, const C&) { return r.complete_after_s < 0 ? NAN : r.complete_after_s; });
  add("uplink loss", [](const R& r, const C&) { return r.uplink_loss; });
  add("frames", [](const R&, const C& c) { return c.frames; });
  add("status frames", [](const R&, const C& c) { return c.status_frames; });
  add("info frames", [](const R&, const C& c) { return c.info_frames; });
  add("track frames", [](const R&, const C& c) { return c.track_frames; });
  add("map frames", [](const R&, const C& c) { return c.map_frames; });
  add("repair frames", [](const R&, const C& c) { return c.repair_frames; });
  add("turns", [](const R&, const C& c) { return c.turns; });
  add("downlink frames", [](const R& r, const C&) { return r.downlink_frames; });
  add("acknowledgements", [](const R&, const C& c) { return c.acknowledgements; });
  add("blocks sent", [](const R&, const C& c) { return c.blocks.sent; });
  add("blocks resent", [](const R&, const C& c) { return c.blocks.resent; });
  add("blocks repeated", [](const R&, const C& c) { return c.blocks.repeated; });
  add("blocks updated", [](const R&, const C& c) { return c.blocks.updated; });
  add("blocks waiting", [](const R&, const C& c) { return c.blocks_waiting; });
  add("blocks in flight", [](const R&, const C& c) { return c.blocks_in_flight; });
  add("loss estimate", [](const R&, const C& c) { return c.loss; });
  return table;
}

struct Scenario {
  const char* name;
  SurveyConfig config;
};

std::vector<Scenario> scenarios(double survey_s, std::uint64_t seed) {
  SurveyConfig slow;
  slow.survey_s = survey_s;
  slow.seed = seed;
  SurveyConfig colour = slow;
  colour.rate_bps = 300;
  colour.frame_bytes = 128;
  colour.colour_bits = 3;
  SurveyConfig away = colour;
  away.ship_off_s = 300;
  away.ship_on_s = 600;
  away.pause_mapping = true;
  away.after_s = 1800;
  return {{"80 bit/s, 32 B, geometry", slow},
          {"300 bit/s, 128 B, colour", colour},
          {"300 bit/s, ship off for 5 minutes, then nothing new", away}};
}

struct Options {
  std::vector<std::string> terrains;
  double survey_s = 1200;
  int seeds = 200, survey_seeds = 3;
  bool json = false;
};

int run(Options o) {
  if (o.terrains.empty()) o.terrains.push_back(FATHOM_DATA_DIR "/pavlopetri/chamber3.ply");
  Page page("The link");
  if (o.seeds > 0) page.add(reliability(o.seeds));
  for (const std::string& terrain : o.terrains) {
    const SeafloorLattice sea(terrain, 0.25);
    for (int seed = 1; seed <= o.survey_seeds; ++seed) {
      std::vector<std::string> names;
      std::vector<SurveyResult> results;
      for (const Scenario& s : scenarios(o.survey_s, static_cast<std::uint64_t>(seed))) {
        names.emplace_back(s.name);
        results.push_back(runSurvey(sea, s.config));
      }
      page.add(surveys(terrain + ", seed " + std::to_string(seed), names, results));
    }
  }
  std::printf("%s", o.json ? page.json().c_str() : page.text().c_str());
  return kExitSuccess;
}

}  // namespace

test::Report linkReport() {
  static Options o;
  return {"link",
          "What crosses the acoustic link: frames until a set of tiles is complete, surveys over a slow link",
          {{"terrain", &o.terrains, "seafloors (PLY); without any, the chamber of the real data"},
           {"--survey-s", &o.survey_s, "length of the survey [s]"},
           {"--seeds", &o.seeds, "runs of each loss; 0: leave this out", 0, 100000},
           {"--survey-seeds", &o.survey_seeds, "runs of each survey", 0, 1000},
           {"--json", &o.json, "everything as JSON"}},
          [] { return run(o); }};
}

}  // namespace fathom::bench
