#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "realtime/base/units.hpp"
#include "recon/topside/report/control_report.hpp"
#include "recon/topside/report/pose_output.hpp"
#include "recon/topside/report/run_record.hpp"
#include "recon/topside/report/slam_report.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;
using web::ReportField, web::Fields, web::Row;

// Every key of the configuration, nested as in its file.
Json configJson(TopsideConfig config) {
  ConfigListing keys;
  visitTopside(keys, config);
  Json out = Json::object();
  for (const ConfigListing::Row& row : keys.rows()) {
    std::string path = "/" + row.key;
    std::replace(path.begin(), path.end(), '.', '/');
    out[Json::json_pointer(path)] = Json::parse(row.value);  // these values are the same in TOML and in JSON
  }
  return out;
}

// By colour, laws of how light falls with range.
Fields lawFields(const std::array<lighting::Attenuation, 3>& law) {
  Fields out;
  constexpr std::array<const char*, 3> kColours = {"red", "green", "blue"};
  for (std::size_t k = 0; k < kColours.size(); ++k)
    out.emplace_back(kColours[k], Fields{{"range_power", law[k].power}, {"per_metre", law[k].per_metre}});
  return out;
}

Fields waterFields(const lighting::WaterLaw& water) {
  Fields out = {{"share", water.share}};
  if (water.share > 0) out.emplace_back("law", lawFields(water.colours));
  return out;
}

Fields lightingFields(const lighting::LightingModel::Report& l) {
  const auto error = [](const char* key, double value, const char* title) {  // null: never tried
    return value < 0 ? ReportField(key, nullptr, title, "-") : ReportField(key, value, title, 1, 100);
  };
  return {{"model", lighting::nameOf(l.used), "model used"},
          {"foretelling_error", Fields{error("whole_image", l.error_whole, "error: whole image [%]"),
                                       error("plain", l.error_plain, "plain [%]"),
                                       error("range_dependent", l.error_range, "range-dependent [%]")}},
          {"outlier_share", l.outlier_share, "samples left out [%]", 2, 100},
          {"saturated_share", l.saturated_share},
          {"black_level", l.black},
          {"tilt", Fields{{"strength", l.tilt}, {"lamp_x_m", l.lamp.x()}, {"lamp_y_m", l.lamp.y()}}},
          {"attenuation", lawFields(l.attenuation)},
          {"memory_bytes", l.memory_bytes}};
}

Fields overlapFields(const OverlapColours& o) {
  return {{"couples", o.couples, "couples of images"},
          {"places", o.places, "places in both images of a couple"},
          {"luminance_before", o.before.luminance,
           "luminance of a place as it came, one white balance, differs by [%]", 1, 100},
          {"luminance_after", o.after.luminance, "luminance corrected [%]", 1, 100},
          {"chroma_before", o.before.chroma, "chroma (CIE a*, b*) as it came, one white balance", 2},
          {"chroma_after", o.after.chroma, "chroma corrected", 2}};
}

// How the rig stands against its calibration.
Fields rigFields(const RigFinding& r) {
  return {{"matches", r.matches},
          {"epipolar_px", r.before},
          {"epipolar_after_px", r.after},
          {"mended", r.moved},
          {"right_turned_deg", web::jsonOf(r.change.rotation / kRadiansPerDegree)},
          {"right_focal_longer", r.change.focal},
          {"right_k1_more", r.change.radial},
          {"paths", r.steps},
          {"ranges_too_long", r.range.scale},
          {"ranges_too_long_per_m", r.range.per_metre},
          {"ranges_sigma", r.range_sigma}};
}

Fields navigationFields(const Navigation& n, bool images_alone) {
  const auto& k = n.counters;
  const auto title = [&](const char* words) { return images_alone ? "" : words; };
  return {{"anchor", Fields{{"source", n.anchor.source, "anchored by"},
                            {"north_m", n.anchor.north},
                            {"east_m", n.anchor.east},
                            {"sigma_m", n.anchor.sigma},
                            {"fixes_used", n.anchor.fixes_used, "fixes of the anchor used"},
                            {"fixes_rejected", n.anchor.fixes_rejected, "fixes of the anchor rejected"}}},
          {"dvl_used", k.dvl_used, title("bottom-track ensembles used")},
          {"dvl_without_bottom", k.dvl_without_bottom},
          {"dvl_rejected", k.dvl_rejected, title("bottom-track ensembles rejected")},
          {"out_of_order", k.out_of_order},
          {"time_leaps", k.time_leaps},
          {"attitude_rejected", k.attitude_rejected},
          {"depth_rejected", k.depth_rejected},
          {"water_rejected", k.water_rejected},
          {"log_entries_skipped", n.skipped_entries},
          {"log_entries_damaged", n.damaged_entries}};
}

Fields stageFields(const StageLine& stage) {
  return {{"seconds", stage.seconds, "seconds", 2},
          {"made", stage.made, "made"},
          {"there", stage.there, "there already"}};
}

// Seconds of one thread a pair, as they were when the results were made.
Json perPair(const RunRecord& r) {
  const auto pairs = static_cast<double>(std::max<std::size_t>(1, r.list->pairs.size()));
  Json out = Json::object();
  for (const auto* costs : {&r.prepare_costs, &r.model_costs})
    for (const auto& [step, seconds] : *costs)
      if (step != "wall_s") out[step] = out.value(step, 0.0) + seconds / pairs;
  return out;
}

Fields levelFields(const LevelSummary& l) {
  const auto megabytes = [](std::uint64_t bytes) { return decimals(static_cast<double>(bytes) / 1e6, 2); };
  return {{"level", l.level, "level"},
          {"tiles", l.tiles, "tiles"},
          {"vertices", l.vertices},
          {"triangles", l.triangles, "triangles"},
          {"area_m2", l.area, "triangles a m²",
           decimals(l.area > 0 ? static_cast<double>(l.triangles) / l.area : 0, 0)},
          {"error_m", l.error, "error at most [mm]", 1, 1e3},
          {"texel_m", l.texel, "texel [mm]", 1, 1e3},
          {"surface_bytes", l.surface_bytes, "MB: surface", megabytes(l.surface_bytes)},
          {"picture_bytes", l.picture_bytes, "texture", megabytes(l.picture_bytes)},
          {"gpu_texture_bytes", l.gpu_bytes, "GPU texture", megabytes(l.gpu_bytes)}};
}

std::vector<Fields> levelRecords(const RunRecord& r) {
  std::vector<Fields> out;
  for (const LevelSummary& level : r.levels) out.push_back(levelFields(level));
  return out;
}

Fields pairFields(const RunRecord& r, bool images_alone) {
  const FuseCounts& counts = r.fused->counts;
  return {{"listed", r.list->pairs.size(), "pairs listed"},
          {"used", counts.used, "pairs in the map"},
          {"without_pose", counts.without_pose,
           images_alone ? "pairs that show too little to be placed" : "pairs outside the navigation"},
          {"unreadable", counts.unreadable, "pairs unreadable"},
          {"too_few_points", counts.too_few_points, "pairs with too few points"},
          {"left_images_alone", r.list->left_alone, "left images without a right one"},
          {"right_images_alone", r.list->right_alone, "right images without a left one"},
          {"times_from_file_names", r.list->from_file_names},
          {"unreadable_images", counts.unreadable_lines}};
}

Fields stereoFields(const FuseCounts& counts) {
  const auto& rejected = counts.rejected;
  return {{"corners", counts.corners, "corners"},
          {"points", counts.points, "stereo points"},
          {"rejected", Fields{{"no_track", rejected.no_track, "rejected: no match"},
                              {"left_right", rejected.left_right, "rejected: left-right check"},
                              {"epipolar", rejected.epipolar, "rejected: off the epipolar line"},
                              {"range", rejected.range, "rejected: range"},
                              {"outlier", rejected.outlier, "rejected: outlier"},
                              {"fish", rejected.fish, "rejected: fish"}}}};
}

// report.json; what has a title is in the page's table of counts.
Fields runFields(const RunRecord& r) {
  const bool images_alone = r.slam != nullptr && !r.slam->parts.empty();
  Fields stages;
  for (const StageLine& stage : r.stages) stages.emplace_back(stage.name, web::jsonOf(stageFields(stage)));
  Json lighting;
  if (!r.list->features_only)
    lighting = web::jsonOf({{"images_learned", r.left_lighting.images},
                            {"unreadable", r.lighting_unreadable},
                            {"overlap", overlapFields(r.overlap)},
                            {"white_balance", r.by_chart ? "chart" : "grey world"},
                            {"water", waterFields(r.water)},
                            {"left", lightingFields(r.left_lighting)},
                            {"right", lightingFields(r.right_lighting)}});
  return {{"software_version", r.software_version},
          {"mission", r.mission},
          {"vehicle", r.vehicle},
          {"dive_id", r.dive_id},
          {"threads", r.threads},
          {"source", r.list->features_only ? "features" : "images"},
          {"pairs", pairFields(r, images_alone)},
          {"lighting", lighting},
          {"rig", rigFields(r.rig)},
          {"stereo", stereoFields(r.fused->counts)},
          {"navigation", navigationFields(*r.navigation, images_alone)},
          r.slam == nullptr ? ReportField("localisation", nullptr, "poses", "dead reckoning")
                            : ReportField("localisation", slamFields(*r.slam)),
          {"fusion", Fields{{"triangles", r.fusion.triangles},
                            {"triangles_skipped", r.fusion.skipped_triangles},
                            {"voxel_updates", r.fusion.voxel_updates},
                            {"voxels_carved", r.fusion.carved_voxels},
                            {"blocks", r.fusion.blocks}}},
          {"model", Fields{{"pieces", r.pieces, "pieces"},
                           {"meshes_fused", r.meshes_fused, "meshes fused, counted in every piece"},
                           {"levels", web::jsonOf(levelRecords(r))},
                           {"texels", r.texels},
                           {"texels_unseen", r.texels_unseen},
                           {"views_outvoted", r.texels_outvoted}}},
          {"mesh", Fields{{"vertices", r.vertices, "mesh vertices"},
                          {"triangles", r.triangles, "mesh triangles"},
                          {"area_m2", r.area}}},
          {"content", r.content, "digest of all files but this report", r.content.substr(0, 16)},
          {"assumed", r.assumed},
          {"memory", Fields{{"peak_bytes", r.peak_bytes, "peak memory of the process",
                             decimals(mebibytes(r.peak_bytes), 0) + " MiB"}}},
          {"work_files_damaged", r.damaged, "work files found damaged and made again"},
          {"times", Fields{{"stages", stages}, {"per_pair_s", perPair(r)}, {"total_s", r.total_seconds}}},
          {"config", configJson(*r.config)}};
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
  report.text("The model that foretold images best, before it learnt them, corrects.");
  web::addTable(report, {web::named("camera", "left", lightingFields(r.left_lighting)),
                         web::named("camera", "right", lightingFields(r.right_lighting))});
  report.text(r.by_chart
                  ? "White balance: by the chart of calibrate-colour."
                  : "White balance: grey world, the mean of the dive's ground is taken to be grey. A chart, "
                    "photographed in the dive's water, gives the true one (calibrate-colour).");
  if (r.water.share > 0)
    report.text(formatted(
        "Ground that images show from several ranges tells how its light falls with range; %.0f %% of "
        "the difference to what the light model took in is beyond doubt, and corrected.",
        100 * r.water.share));
  if (r.overlap.places == 0) return;
  report.text("The same places in two images that show them, medians:");
  report.table({}, web::rowsOf(overlapFields(r.overlap)));
}

// Stages of a pair as table 2 of Johnson-Roberson et al. 2010 counts them.
constexpr double kReferenceSeconds = 0.47;  // a pair: stereo, fusion, simplification, meshes with texture

void addTimes(web::ReportPage& report, const RunRecord& r) {
  std::vector<Fields> stages;
  for (const StageLine& stage : r.stages)
    stages.push_back(web::named("stage", stage.name, stageFields(stage)));
  web::addTable(report, stages);
  const Json seconds = perPair(r);
  const auto ms = [&](std::initializer_list<const char*> steps) {
    double sum = 0;
    for (const char* step : steps) sum += seconds.value(step, 0.0);
    return 1e3 * sum;
  };
  const double stereo = ms({"read", "lighting", "stereo", "mesh"}), fusion = ms({"fusion"}),
               simplify = ms({"simplify"}), texture = ms({"atlas", "images", "texture", "encode"});
  const double same = stereo + fusion + simplify + texture;
  report.text("In all " + decimals(r.total_seconds, 2) +
              " s. Of one pair, milliseconds of one thread, as they were when the results were made:");
  report.table({}, {{"stereo (reading, light, matching, mesh)", decimals(stereo, 1)},
                    {"fusion", decimals(fusion, 1)},
                    {"simplification", decimals(simplify, 1)},
                    {"texture (charts, images, blending, compression)", decimals(texture, 1)},
                    {"these stages", decimals(same, 1)},
                    {"these stages on " + std::to_string(r.threads) + " threads",
                     decimals(same / std::max(1, r.threads), 1)},
                    {"the same stages in Johnson-Roberson et al. 2010, table 2, on their machine",
                     decimals(1e3 * kReferenceSeconds, 0)},
                    {"features for localisation, layers", decimals(ms({"features", "layers"}), 1)}});
}

void addModel(web::ReportPage& report, const RunRecord& r) {
  std::uint64_t bytes = 0;
  for (const LevelSummary& l : r.levels) bytes += l.surface_bytes + l.picture_bytes + l.gpu_bytes;
  const double megabytes_a_pair =
      static_cast<double>(bytes) / 1e6 / static_cast<double>(std::max<std::size_t>(1, r.list->pairs.size()));
  web::addTable(report, levelRecords(r));
  report.text(decimals(megabytes_a_pair, 3) + " MB of tiles a pair.");
}

void addLayers(web::ReportPage& report, const std::filesystem::path& folder, const RunRecord& r) {
  for (const LayerInfo& layer : r.layers)
    if (!layer.picture.empty())
      report.pictureFile(folder / layer.picture,
                         layer.title + (layer.unit.empty() ? "" : " [" + layer.unit + "]"));
}

}  // namespace

void writeReportJson(const std::filesystem::path& path, const RunRecord& r) {
  const Json report = web::jsonOf(runFields(r));
  writeFile(path, report.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

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
  if (r.slam != nullptr) {
    addParts(report, r.slam->parts, r.list->pairs);
    addControl(report, r.slam->control);
  }
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
  report.table({}, web::rowsOf(runFields(r)));
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
