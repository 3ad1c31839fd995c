// Measures the link: frames sent until a set of tiles is complete, a survey over a slow link, a ship that was
// switched off.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <iostream>
#include <nlohmann/json.hpp>

#include "realtime/kernel/input_error.hpp"
#include "tests/bench/link/survey.hpp"

using namespace fathom;
using nlohmann::ordered_json;

namespace {

ordered_json jsonOf(const bench::SurveyResult& r) {
  const auto& c = r.counters;
  return {{"imaged_m2", r.imaged_m2},
          {"judged_m2", r.judged_m2},
          {"in_time_share", r.in_time_share},
          {"in_time_at_any_spacing", r.coarse_in_time_share},
          {"shown_share", r.shown_share},
          {"p50_s", r.p50_s},
          {"p95_s", r.p95_s},
          {"max_error_m", r.max_error_m},
          {"bytes_per_m2", r.bytes_per_m2},
          {"bytes_per_map_frame", r.bytes_per_map_frame},
          {"blocks_per_map_frame", r.blocks_per_map_frame},
          {"not_sending_share", r.listening_share},
          {"complete_after_s", r.complete_after_s},
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
          {"blocks_updated", c.blocks.updated},
          {"blocks_waiting", c.blocks_waiting},
          {"blocks_in_flight", c.blocks_in_flight},
          {"loss_estimate", c.loss}};
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::string> terrains;
  double survey_s = 1200;
  CLI::App app{"measures the link"};
  app.add_option("terrain", terrains, "seafloors (PLY)");
  app.add_option("--survey-s", survey_s);
  CLI11_PARSE(app, argc, argv);
  if (terrains.empty()) terrains.push_back(std::string(FATHOM_DATA_DIR) + "/pavlopetri/chamber3.ply");
  for (const std::string& terrain : terrains) {
    const bench::SeafloorLattice sea(terrain, 0.25);
    for (const double rate : {80.0, 300.0}) {
      bench::SurveyConfig config;
      config.rate_bps = rate;
      config.frame_bytes = rate < 100 ? 32 : 128;
      config.colour_bits = rate < 100 ? 0 : 3;
      config.survey_s = survey_s;
      std::cout << terrain << " " << rate << "\n" << jsonOf(bench::runSurvey(sea, config)).dump(1) << "\n";
    }
  }
  return 0;
}
