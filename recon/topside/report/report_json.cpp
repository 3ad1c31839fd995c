#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/units.hpp"
#include "recon/topside/report/run_record.hpp"
#include "recon/topside/report/slam_json.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;

const char* nameOf(surface::BlendMode mode) {
  constexpr std::array<const char*, 3> kNames = {"bands", "average", "unblended"};
  return kNames[static_cast<std::size_t>(mode)];
}

Json configJson(const TopsideConfig& c) {
  return {{"lighting",
           {{"images", c.lighting_images},
            {"target_mean", c.lighting.target_mean},
            {"target_sigma", c.lighting.target_sigma},
            {"min_images", c.lighting.min_images},
            {"grid_px", c.lighting.grid},
            {"saturated", c.lighting.saturated},
            {"outlier_sigma", c.lighting.outlier},
            {"model", lighting::nameOf(c.lighting.choice)}}},
          {"stereo",
           {{"max_features", c.stereo.max_features},
            {"window_px", c.stereo.window},
            {"method", c.dense_stereo ? "dense" : "sparse"},
            {"max_epipolar_px", c.stereo.max_epipolar_distance},
            {"max_left_right_px", c.stereo.max_left_right_distance},
            {"sigma_scale", c.stereo.sigma_scale},
            {"max_edge_m", c.stereo.max_edge},
            {"min_range_m", c.stereo.min_range},
            {"max_range_m", c.stereo.max_range},
            {"search_radius_px", c.stereo.search_radius},
            {"mend_rig", c.mend_rig},
            {"min_points", c.min_points}}},
          {"fusion",
           {{"voxel_m", c.fusion.voxel},
            {"truncation_m", c.fusion.truncation},
            {"border_m", c.fusion.border},
            {"min_observations", c.fusion.min_observations},
            {"carve", c.fusion.carve},
            {"min_component_m2", c.min_component}}},
          {"model",
           {{"texture", c.model.texture},
            {"blend", nameOf(c.model.blend.mode)},
            {"picture_quality", c.model.picture.quality},
            {"overlap_m", c.model.division.overlap}}},
          {"slam",
           {{"enabled", c.slam},
            {"bundle", c.bundle},
            {"features", c.slam_features},
            {"candidates_per_pair", c.slam_candidates},
            {"turned_sigmas", c.navigation.turned_sigmas}}},
          {"navigation",
           {{"max_dvl_gap_s", c.max_dvl_gap},
            {"max_speed_mps", c.max_speed},
            {"default_altitude_m", c.default_altitude}}},
          {"run", {{"pairing_tolerance_s", c.pairing_tolerance}}}};
}

Json lightingJson(const lighting::LightingModel::Report& l) {
  const auto error = [](double value) { return value < 0 ? Json() : Json(value); };  // null: never tried
  Json attenuation = Json::object();
  constexpr std::array<const char*, 3> kColours = {"red", "green", "blue"};
  for (std::size_t k = 0; k < kColours.size(); ++k)
    attenuation[kColours[k]] = {{"range_power", l.attenuation[k].power},
                                {"per_metre", l.attenuation[k].per_metre}};
  return {{"model", lighting::nameOf(l.used)},
          {"foretelling_error",
           {{"whole_image", error(l.error_whole)},
            {"plain", error(l.error_plain)},
            {"range_dependent", error(l.error_range)}}},
          {"outlier_share", l.outlier_share},
          {"saturated_share", l.saturated_share},
          {"black_level", l.black},
          {"tilt", {{"strength", l.tilt}, {"lamp_x_m", l.lamp.x()}, {"lamp_y_m", l.lamp.y()}}},
          {"attenuation", attenuation},
          {"memory_bytes", l.memory_bytes}};
}

Json lightingJson(const RunRecord& r) {
  return {{"images_learned", r.left_lighting.images},
          {"unreadable", r.lighting_unreadable},
          {"overlap",
           {{"couples", r.overlap.couples},
            {"places", r.overlap.places},
            {"luminance_before", r.overlap.before.luminance},
            {"luminance_after", r.overlap.after.luminance},
            {"chroma_before", r.overlap.before.chroma},
            {"chroma_after", r.overlap.after.chroma}}},
          {"left", lightingJson(r.left_lighting)},
          {"right", lightingJson(r.right_lighting)}};
}

// How the rig stands against its calibration.
Json rigJson(const RigFinding& r) {
  return {{"matches", r.matches},
          {"epipolar_px", r.before},
          {"epipolar_after_px", r.after},
          {"mended", r.moved},
          {"right_turned_deg",
           {r.rotation.x() / kRadiansPerDegree, r.rotation.y() / kRadiansPerDegree,
            r.rotation.z() / kRadiansPerDegree}},
          {"right_focal_longer", r.focal},
          {"paths", r.steps},
          {"ranges_too_long", r.range.scale},
          {"ranges_too_long_per_m", r.range.per_metre},
          {"ranges_sigma", r.range_sigma}};
}

Json navigationJson(const Navigation& n) {
  const auto& k = n.counters;
  return {{"anchor",
           {{"source", n.anchor.source},
            {"north_m", n.anchor.north},
            {"east_m", n.anchor.east},
            {"sigma_m", n.anchor.sigma},
            {"fixes_used", n.anchor.fixes_used},
            {"fixes_rejected", n.anchor.fixes_rejected}}},
          {"dvl_used", k.dvl_used},
          {"dvl_without_bottom", k.dvl_without_bottom},
          {"dvl_rejected", k.dvl_rejected},
          {"out_of_order", k.out_of_order},
          {"time_leaps", k.time_leaps},
          {"attitude_rejected", k.attitude_rejected},
          {"depth_rejected", k.depth_rejected},
          {"water_rejected", k.water_rejected},
          {"log_entries_skipped", n.skipped_entries},
          {"log_entries_damaged", n.damaged_entries}};
}

Json stagesJson(const RunRecord& r) {
  Json stages = Json::object();
  for (const StageLine& stage : r.stages)
    stages[stage.name] = {{"seconds", stage.seconds}, {"made", stage.made}, {"there", stage.there}};
  return stages;
}

// Seconds of one thread a pair, as they were when the results were made.
Json perPairJson(const RunRecord& r) {
  const auto pairs = static_cast<double>(std::max<std::size_t>(1, r.list->pairs.size()));
  Json per_pair = Json::object();
  for (const auto* costs : {&r.prepare_costs, &r.model_costs})
    for (const auto& [step, seconds] : *costs)
      if (step != "wall_s") per_pair[step] = per_pair.value(step, 0.0) + seconds / pairs;
  return per_pair;
}

Json modelJson(const RunRecord& r) {
  Json levels = Json::array();
  for (const LevelSummary& level : r.levels)
    levels.push_back({{"level", level.level},
                      {"tiles", level.tiles},
                      {"vertices", level.vertices},
                      {"triangles", level.triangles},
                      {"area_m2", level.area},
                      {"error_m", level.error},
                      {"texel_m", level.texel},
                      {"surface_bytes", level.surface_bytes},
                      {"picture_bytes", level.picture_bytes},
                      {"gpu_texture_bytes", level.gpu_bytes}});
  return {{"pieces", r.pieces}, {"meshes_fused", r.meshes_fused},   {"levels", levels},
          {"texels", r.texels}, {"texels_unseen", r.texels_unseen}, {"views_outvoted", r.texels_outvoted}};
}

}  // namespace

void writeReportJson(const std::filesystem::path& path, const RunRecord& r) {
  const FuseCounts& counts = r.fused->counts;
  const Json report = {
      {"software_version", r.software_version},
      {"mission", r.mission},
      {"vehicle", r.vehicle},
      {"dive_id", r.dive_id},
      {"threads", r.threads},
      {"source", r.list->features_only ? "features" : "images"},
      {"pairs",
       {{"listed", r.list->pairs.size()},
        {"used", counts.used},
        {"without_pose", counts.without_pose},
        {"unreadable", counts.unreadable},
        {"too_few_points", counts.too_few_points},
        {"left_images_alone", r.list->left_alone},
        {"right_images_alone", r.list->right_alone},
        {"times_from_file_names", r.list->from_file_names},
        {"unreadable_images", counts.unreadable_lines}}},
      {"lighting", r.list->features_only ? Json() : lightingJson(r)},
      {"rig", rigJson(r.rig)},
      {"stereo",
       {{"corners", counts.corners},
        {"points", counts.points},
        {"rejected",
         {{"no_track", counts.rejected.no_track},
          {"left_right", counts.rejected.left_right},
          {"epipolar", counts.rejected.epipolar},
          {"range", counts.rejected.range},
          {"outlier", counts.rejected.outlier},
          {"fish", counts.rejected.fish}}}}},
      {"navigation", navigationJson(*r.navigation)},
      {"localisation", r.slam == nullptr ? Json() : slamJson(*r.slam)},
      {"fusion",
       {{"triangles", r.fusion.triangles},
        {"triangles_skipped", r.fusion.skipped_triangles},
        {"voxel_updates", r.fusion.voxel_updates},
        {"voxels_carved", r.fusion.carved_voxels},
        {"blocks", r.fusion.blocks}}},
      {"model", modelJson(r)},
      {"mesh", {{"vertices", r.vertices}, {"triangles", r.triangles}, {"area_m2", r.area}}},
      {"content", r.content},
      {"assumed", r.assumed},
      {"memory", {{"peak_bytes", r.peak_bytes}}},
      {"work_files_damaged", r.damaged},
      {"times", {{"stages", stagesJson(r)}, {"per_pair_s", perPairJson(r)}, {"total_s", r.total_seconds}}},
      {"config", configJson(*r.config)}};
  writeFile(path, report.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

}  // namespace fathom::topside
