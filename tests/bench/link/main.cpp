// Measures the link: frames sent until a set of tiles is complete, a survey over a slow link, a ship that was
// switched off.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>

#include "realtime/kernel/input_error.hpp"
#include "tests/bench/link/reliability.hpp"
#include "tests/bench/link/survey.hpp"

using namespace fathom;
using nlohmann::ordered_json;

namespace {

ordered_json jsonOf(const bench::SurveyResult& r) {
  const auto& c = r.counters;
  return {
      {"imaged_m2", r.imaged_m2},
      {"judged_m2", r.judged_m2},
      {"in_time_share", r.in_time_share},
      {"in_time_at_any_spacing", r.coarse_in_time_share},
      {"shown_share", r.shown_share},
      {"p50_s", r.p50_s},
      {"p95_s", r.p95_s < 1e8 ? ordered_json(r.p95_s) : ordered_json(nullptr)},
      {"max_error_m", r.max_error_m},
      {"bytes_per_m2", r.bytes_per_m2},
      {"bytes_per_map_frame", r.bytes_per_map_frame},
      {"blocks_per_map_frame", r.blocks_per_map_frame},
      {"not_sending_share", r.listening_share},
      {"complete_after_s", r.complete_after_s < 0 ? ordered_json(nullptr) : ordered_json(r.complete_after_s)},
      {"uplink_loss", r.uplink_loss},
      {"frames", c.frames},
      {"status_frames", c.status_frames},
      {"info_frames", c.info_frames},
      {"track_frames", c.track_frames},
      {"map_frames", c.map_frames},
      {"repair_frames", c.repair_frames},
      {"turns", c.turns},
      {"downlink_frames", r.downlink_frames},
      {"acknowledgements", c.acknowledgements},
      {"blocks_sent", c.blocks.sent},
      {"blocks_resent", c.blocks.resent},
      {"blocks_repeated", c.blocks.repeated},
      {"blocks_updated", c.blocks.updated},
      {"blocks_waiting", c.blocks_waiting},
      {"blocks_in_flight", c.blocks_in_flight},
      {"loss_estimate", c.loss}};
}

ordered_json reliability(int seeds) {
  ordered_json rows = ordered_json::array();
  for (const bool feedback : {true, false})
    for (const double burst : {0.0, 5.0})
      for (const double loss : {0.1, 0.3, 0.5}) {
        const bench::ReliabilityResult r = bench::measureReliability({loss, burst, feedback, seeds});
        rows.push_back({{"acknowledged", feedback},
                        {"mean_burst", burst},
                        {"loss", loss},
                        {"packets", r.packets},
                        {"bound", r.bound},
                        {"mean_frames", r.mean_frames},
                        {"standard_error", r.standard_error},
                        {"ratio", r.mean_frames / r.bound},
                        {"p95_ratio", r.p95_frames / r.bound},
                        {"finished_share", r.finished_share},
                        {"mean_complete", r.mean_complete}});
      }
  return rows;
}

struct Scenario {
  const char* name;
  bench::SurveyConfig config;
};

std::vector<Scenario> scenarios(double survey_s, std::uint64_t seed) {
  bench::SurveyConfig slow;
  slow.survey_s = survey_s;
  slow.seed = seed;
  bench::SurveyConfig colour = slow;
  colour.rate_bps = 300;
  colour.frame_bytes = 128;
  colour.colour_bits = 3;
  bench::SurveyConfig away = colour;
  away.ship_off_s = 300;
  away.ship_on_s = 600;
  away.pause_mapping = true;
  away.after_s = 1800;
  return {{"80 bit/s, 32 B, geometry", slow},
          {"300 bit/s, 128 B, colour", colour},
          {"300 bit/s, ship off for 5 minutes, then nothing new", away}};
}

void print(const ordered_json& rows) {
  for (const auto& row : rows) {
    std::string line;
    for (const auto& [key, value] : row.items()) {
      char number[32];
      if (value.is_number_float()) std::snprintf(number, sizeof number, "%.3f", value.get<double>());
      line += key + " " + (value.is_number_float() ? std::string(number) : value.dump()) + "  ";
    }
    std::printf("%s\n\n", line.c_str());
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> terrains;
  double survey_s = 1200;
  int seeds = 200, survey_seeds = 3;
  bool json = false;
  CLI::App app{"measures the link"};
  app.add_option("terrain", terrains, "seafloors (PLY); without any, the chamber of the real data");
  app.add_option("--survey-s", survey_s, "length of the survey [s]");
  app.add_option("--seeds", seeds, "runs of each loss; 0: leave this out")->check(CLI::Range(0, 100000));
  app.add_option("--survey-seeds", survey_seeds, "runs of each survey")->check(CLI::Range(0, 1000));
  app.add_flag("--json", json, "everything as JSON");
  CLI11_PARSE(app, argc, argv);
  if (terrains.empty()) terrains.push_back(std::string(FATHOM_DATA_DIR) + "/pavlopetri/chamber3.ply");
  try {
    ordered_json report;
    report["reliability"] = seeds > 0 ? reliability(seeds) : ordered_json::array();
    report["surveys"] = ordered_json::array();
    for (const std::string& terrain : terrains) {
      const bench::SeafloorLattice sea(terrain, 0.25);
      for (int seed = 1; seed <= survey_seeds; ++seed)
        for (const Scenario& s : scenarios(survey_s, static_cast<std::uint64_t>(seed))) {
          ordered_json row{{"terrain", terrain}, {"scenario", s.name}, {"seed", seed}};
          row.update(jsonOf(bench::runSurvey(sea, s.config)));
          report["surveys"].push_back(row);
        }
    }
    if (json) {
      std::cout << report.dump(1) << "\n";
    } else {
      print(report["reliability"]);
      print(report["surveys"]);
    }
  } catch (const InputError& e) {
    std::fprintf(stderr, "report_link: %s\n", e.what());
    return 2;
  }
  return 0;
}
