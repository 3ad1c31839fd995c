#include <algorithm>
#include <cmath>
#include <initializer_list>

#include "realtime/base/text.hpp"
#include "recon/topside/report/control_report.hpp"
#include "recon/topside/report/pose_output.hpp"
#include "recon/topside/report/run_record.hpp"
#include "recon/topside/report/slam_json.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::topside {
namespace {

using web::Row;

void addLocalisation(std::vector<Row>& rows, const SlamResult* slam) {
  if (slam == nullptr) {
    rows.push_back({"poses", "dead reckoning"});
    return;
  }
  std::size_t removed = 0;
  for (const slam::NavigationLink& link : slam->closures) removed += link.kept ? 0 : 1;
  rows.push_back({"visual odometry links", slam->odometry.size()});
  rows.push_back({"closures tried", slam->tried.size()});
  rows.push_back({"closures", slam->closures.size() - removed});
  rows.push_back({"closures taken out again", removed});
  rows.push_back({"closures left out: nothing confirmed them", slam->unconfirmed});
  rows.push_back({"ground seen before, expected", decimals(slam->crossings_expected, 1) + " m of track"});
  rows.push_back({"of it without a closure", decimals(slam->crossings_unverified, 1) + " m"});
  for (const auto& [name, value] : bundleRows(*slam)) rows.push_back({name, value});
  if (slam->parts.empty())
    rows.push_back({"moved from dead reckoning", decimals(slam->moved_rms, 3) + " m rms"});
}

// Why nothing joins a part's first pair to the one before it.
std::string reasonOf(closure::Refusal why) {
  if (why == closure::Refusal::kNone) return "";
  const std::string name(closure::nameOf(why));
  return why == closure::Refusal::kNoFeatures
             ? "shows too little: dark, blurred or bare (" + name + ")"
             : "too little in common: no overlap, too fast a motion, or bare ground (" + name + ")";
}

void addParts(web::ReportPage& report, const RunRecord& r) {
  if (r.slam == nullptr || r.slam->parts.size() < 2) return;
  report.section("Parts");
  report.text("Each stands for itself: distances from one to another mean nothing.");
  std::vector<Row> rows;
  for (const SlamResult::Part& part : r.slam->parts)
    rows.push_back({rows.size() + 1, part.pairs.size(), r.list->pairs[part.pairs.front()].left,
                    r.list->pairs[part.pairs.back()].left, reasonOf(part.why)});
  report.table({"part, west to east", "pairs", "first image", "last image", "not joined to the image before"},
               rows);
}

void addMapPictures(web::ReportPage& report, const RunRecord& r, const MapPicture& map) {
  const auto add = [&](const std::vector<std::uint8_t>& rgb, const std::string& caption) {
    if (!rgb.empty()) report.picture(toPng(rgb, map.width, map.height), caption);
  };
  add(map.rgb, "Depth from " + decimals(map.shallowest, 2) + " m (light) to " + decimals(map.deepest, 2) +
                   " m (dark), north up, " + decimals(map.width * map.metres_per_pixel, 1) +
                   " m wide, light from the north-west");
  add(map.rgb_texture, r.list->features_only ? "Colours of the features"
                                             : "Colours of the seafloor after lighting correction");
}

// The dive's track, and the pairs' places in the map and out of it.
web::Plot trackPlot(const RunRecord& r) {
  using Kind = web::Series::Kind;
  web::Series track{.label = "the vehicle's track", .colour = web::kGrey},
      used{.label = "pairs in the map", .kind = Kind::kDots, .colour = web::kGreen},
      left_out{.label = "pairs with too few points", .kind = Kind::kDots, .colour = web::kRed};
  for (const NavigatedPose& p : r.navigation->track)
    if (p.T_nav_body) track.at.push_back(eastNorth(*p.T_nav_body));
  for (const FusedPair& p : r.fused->pairs) (p.used ? used : left_out).at.push_back(eastNorth(p.T_nav_body));
  return {.title = "Track of the dive, north up",
          .x = "east [m]",
          .y = "north [m]",
          .series = {std::move(track), std::move(used), std::move(left_out)},
          .equal = true};
}

void addLighting(web::ReportPage& report, const RunRecord& r) {
  const auto error = [](double value) {
    return value < 0 ? std::string("-") : decimals(100 * value, 1) + " %";
  };
  std::vector<Row> rows;
  for (const auto& [name, l] : {std::pair("left", &r.left_lighting), std::pair("right", &r.right_lighting)})
    rows.push_back({name, lighting::nameOf(l->used), error(l->error_whole), error(l->error_plain),
                    error(l->error_range), decimals(100 * l->outlier_share, 2) + " %"});
  report.text("The model that foretold images best, before it learnt them, corrects.");
  report.table({"camera", "model used", "error: whole image", "plain", "range-dependent", "samples left out"},
               rows);
  if (r.overlap.places == 0) return;
  report.text("The same places in two images that show them, medians over " +
              std::to_string(r.overlap.places) + " places in " + std::to_string(r.overlap.couples) +
              " couples of images:");
  report.table({"", "luminance differs by", "chroma (CIE a*, b*) by"},
               {{"as they came, one white balance", decimals(100 * r.overlap.before.luminance, 1) + " %",
                 decimals(r.overlap.before.chroma, 2)},
                {"corrected", decimals(100 * r.overlap.after.luminance, 1) + " %",
                 decimals(r.overlap.after.chroma, 2)}});
}

// Stages of a pair as table 2 of Johnson-Roberson et al. 2010 counts them.
constexpr double kReferenceSeconds = 0.47;  // a pair: stereo, fusion, simplification, meshes with texture

void addTimes(web::ReportPage& report, const RunRecord& r) {
  std::vector<Row> stages;
  for (const StageLine& stage : r.stages)
    stages.push_back({stage.name, decimals(stage.seconds, 2), stage.made, stage.there});
  stages.push_back({"total", decimals(r.total_seconds, 2), "", ""});
  const auto pairs = static_cast<double>(std::max<std::size_t>(1, r.list->pairs.size()));
  const auto ms = [&](std::initializer_list<const char*> steps) {
    double sum = 0;
    for (const char* step : steps)
      for (const auto* costs : {&r.prepare_costs, &r.model_costs})
        if (const auto found = costs->find(step); found != costs->end()) sum += found->second;
    return 1e3 * sum / pairs;
  };
  const double stereo = ms({"read", "lighting", "stereo", "mesh"}), fusion = ms({"fusion"}),
               simplify = ms({"simplify"}), texture = ms({"atlas", "images", "texture", "encode"}),
               others = ms({"features", "layers"});
  const double same = stereo + fusion + simplify + texture;
  report.table({"stage", "seconds", "made", "there already"}, stages);
  report.text("Of one pair, milliseconds of one thread, as they were when the results were made:");
  report.table({}, {{"stereo (reading, light, matching, mesh)", decimals(stereo, 1)},
                    {"fusion", decimals(fusion, 1)},
                    {"simplification", decimals(simplify, 1)},
                    {"texture (charts, images, blending, compression)", decimals(texture, 1)},
                    {"these stages", decimals(same, 1)},
                    {"these stages on " + std::to_string(r.threads) + " threads",
                     decimals(same / std::max(1, r.threads), 1)},
                    {"the same stages in Johnson-Roberson et al. 2010, table 2, on their machine",
                     decimals(1e3 * kReferenceSeconds, 0)},
                    {"features for localisation, layers", decimals(others, 1)},
                    {"peak memory of the process",
                     decimals(static_cast<double>(r.peak_bytes) / 1048576.0, 0) + " MiB"}});
}

void addModel(web::ReportPage& report, const RunRecord& r) {
  std::vector<Row> levels;
  std::uint64_t bytes = 0;
  for (const LevelSummary& l : r.levels) {
    const auto megabytes = [](std::uint64_t b) { return decimals(static_cast<double>(b) / 1e6, 2); };
    levels.push_back({l.level, l.tiles, l.triangles,
                      decimals(l.area > 0 ? static_cast<double>(l.triangles) / l.area : 0, 0),
                      decimals(1e3 * l.texel, 1), decimals(1e3 * l.error, 1), megabytes(l.surface_bytes),
                      megabytes(l.picture_bytes), megabytes(l.gpu_bytes)});
    bytes += l.surface_bytes + l.picture_bytes + l.gpu_bytes;
  }
  const double megabytes_a_pair =
      static_cast<double>(bytes) / 1e6 / static_cast<double>(std::max<std::size_t>(1, r.list->pairs.size()));
  report.table({"level", "tiles", "triangles", "triangles a m²", "texel [mm]", "error at most [mm]",
                "MB: surface", "texture", "GPU texture"},
               levels);
  report.text(std::to_string(r.pieces) + " pieces; " + std::to_string(r.meshes_fused) +
              " meshes fused, counted in every piece; " + decimals(megabytes_a_pair, 3) +
              " MB of tiles a pair. Digest of all files but this report: " + r.content.substr(0, 16) + ".");
}

void addLayers(web::ReportPage& report, const std::filesystem::path& folder, const RunRecord& r) {
  for (const LayerInfo& layer : r.layers)
    if (!layer.picture.empty())
      report.pictureFile(folder / layer.picture,
                         layer.title + (layer.unit.empty() ? "" : " [" + layer.unit + "]"));
}

std::vector<Row> runCountRows(const RunRecord& r) {
  const FuseCounts& counts = r.fused->counts;
  const Anchor& anchor = r.navigation->anchor;
  const bool images_alone = r.slam != nullptr && !r.slam->parts.empty();
  std::vector<Row> rows = {
      {"pairs listed", r.list->pairs.size()},
      {"pairs in the map", counts.used},
      {images_alone ? "pairs that show too little to be placed" : "pairs outside the navigation",
       counts.without_pose},
      {"pairs unreadable", counts.unreadable},
      {"pairs with too few points", counts.too_few_points},
      {"left images without a right one", r.list->left_alone},
      {"right images without a left one", r.list->right_alone},
      {"corners", counts.corners},
      {"stereo points", counts.points},
      {"rejected: no match", counts.rejected.no_track},
      {"rejected: left-right check", counts.rejected.left_right},
      {"rejected: off the epipolar line", counts.rejected.epipolar},
      {"rejected: range", counts.rejected.range},
      {"rejected: outlier", counts.rejected.outlier},
      {"rejected: fish", counts.rejected.fish}};
  if (!images_alone) {
    rows.push_back({"bottom-track ensembles used", r.navigation->counters.dvl_used});
    rows.push_back({"bottom-track ensembles rejected", r.navigation->counters.dvl_rejected});
  }
  rows.push_back({"anchored by", anchor.source + " (" + std::to_string(anchor.fixes_used) + " fixes, " +
                                     std::to_string(anchor.fixes_rejected) + " rejected)"});
  addLocalisation(rows, r.slam);
  rows.push_back({"mesh vertices", r.vertices});
  rows.push_back({"mesh triangles", r.triangles});
  rows.push_back({"work files found damaged and made again", r.damaged});
  return rows;
}

}  // namespace

void writeReportHtml(const std::filesystem::path& path, const RunRecord& r, const MapPicture& map) {
  web::ReportPage report(
      r.vehicle + ", dive " + std::to_string(r.dive_id),
      r.mission + ". fathom-topside " + r.software_version + ", " + std::to_string(r.fused->counts.used) +
          " of " + std::to_string(r.list->pairs.size()) + " stereo pairs, " + decimals(r.area, 1) +
          " m² in " + decimals(r.total_seconds, 1) + " s on " + std::to_string(r.threads) + " threads.");
  report.section("To know");
  if (r.list->features_only)
    report.text("A mission without images: made from features that were matched before.");
  if (const auto warning = warningOf(r.rig)) report.warning(*warning);
  if (r.slam != nullptr)
    for (const std::string& warning : slamWarnings(*r.slam)) report.warning(warning);
  report.section("Assumed");
  report.list(r.assumed);
  report.section("Map");
  addMapPictures(report, r, map);
  addParts(report, r);
  if (r.slam != nullptr) addControl(report, r.slam->control);
  report.section("Track");
  report.plot(trackPlot(r));
  report.section("Times");
  addTimes(report, r);
  report.section("Model");
  addModel(report, r);
  report.section("Layers");
  addLayers(report, path.parent_path(), r);
  report.section("Lighting");
  if (!r.list->features_only) addLighting(report, r);
  report.section("Counts");
  report.table({}, runCountRows(r));
  report.section("Unreadable");
  std::vector<std::string> lines = r.fused->counts.unreadable_lines;
  constexpr std::size_t kLines = 20;
  if (lines.size() > kLines) {
    const std::string more = std::to_string(lines.size() - kLines) + " more stand in report.json";
    lines.resize(kLines);
    lines.push_back(more);
  }
  report.list(lines);
  report.write(path);
}

}  // namespace fathom::topside
