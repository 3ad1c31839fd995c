#include <sodium.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <initializer_list>
#include <iterator>
#include <nlohmann/json.hpp>

#include "recon/topside/report/html_text.hpp"
#include "recon/topside/report/report.hpp"
#include "recon/topside/report/slam_json.hpp"
#include "telemetry/web/report_page.hpp"

namespace fathom::topside {
namespace {

using Json = nlohmann::ordered_json;  // parts of a report as telemetry/web/report/src/content.ts has them

Json text(const std::string& words) {
  return {{"text", words}};
}

Json table(const Json& head, const Json& rows) {
  return {{"table", {{"head", head}, {"rows", rows}}}};
}

Json row(const std::string& name, const std::string& value) {
  return Json::array({name, value});
}
template <typename Integer>
Json row(const std::string& name, Integer value) {
  return row(name, std::to_string(value));
}

Json picture(const std::string& png, const std::string& caption) {
  std::string base64(sodium_base64_ENCODED_LEN(png.size(), sodium_base64_VARIANT_ORIGINAL), '\0');
  sodium_bin2base64(base64.data(), base64.size(), reinterpret_cast<const unsigned char*>(png.data()),
                    png.size(), sodium_base64_VARIANT_ORIGINAL);
  base64.pop_back();  // the terminating zero
  return {{"picture", {{"source", "data:image/png;base64," + base64}, {"caption", caption}}}};
}

void addLocalisation(Json& rows, const SlamResult* slam) {
  if (slam == nullptr) {
    rows.push_back(row("poses", std::string("dead reckoning")));
    return;
  }
  std::size_t removed = 0;
  for (const slam::NavigationLink& link : slam->closures) removed += link.kept ? 0 : 1;
  rows.push_back(row("visual odometry links", slam->odometry.size()));
  rows.push_back(row("closures tried", slam->tried.size()));
  rows.push_back(row("closures", slam->closures.size() - removed));
  rows.push_back(row("closures taken out again", removed));
  rows.push_back(row("closures left out: nothing confirmed them", slam->unconfirmed));
  rows.push_back(row("ground seen before, expected", fixedDigits(slam->crossings_expected, 1) + " m of way"));
  rows.push_back(row("of it without a closure", fixedDigits(slam->crossings_unverified, 1) + " m"));
  rows.push_back(row("moved from dead reckoning", fixedDigits(slam->moved_rms, 3) + " m rms"));
}

Json mapPictures(const RunRecord& r, const MapPicture& map) {
  Json parts = Json::array();
  const auto add = [&](const std::vector<std::uint8_t>& rgb, const std::string& caption) {
    if (!rgb.empty()) parts.push_back(picture(toPng(rgb, map.width, map.height), caption));
  };
  add(map.rgb, "Depth from " + fixedDigits(map.shallowest, 2) + " m (light) to " +
                   fixedDigits(map.deepest, 2) + " m (dark), north up, " +
                   fixedDigits(map.width * map.metres_per_pixel, 1) + " m wide, light from the north-west");
  add(map.rgb_texture, r.list->features_only ? "Colours of the features"
                                             : "Colours of the seafloor after lighting correction");
  return parts;
}

// The dive's track, and the pairs' places in the map and out of it.
Json trackPlot(const RunRecord& r) {
  struct Places {
    Json east = Json::array(), north = Json::array();
    void add(const SE3& pose) {
      const auto millimetres = [](double v) { return std::round(v * 1e3) / 1e3; };
      east.push_back(millimetres(pose.translation().y()));
      north.push_back(millimetres(pose.translation().x()));
    }
    [[nodiscard]] Json series(const char* label, const char* kind, const char* colour) const {
      return {{"label", label}, {"kind", kind}, {"colour", colour}, {"x", east}, {"y", north}};
    }
  } way, used, left_out;
  for (const NavigatedPose& p : r.navigation->track)
    if (p.T_nav_body) way.add(*p.T_nav_body);
  for (const FusedPair& p : r.fused->pairs) (p.used ? used : left_out).add(p.T_nav_body);
  return {{"plot",
           {{"title", "Track of the dive, north up"},
            {"x", "east [m]"},
            {"y", "north [m]"},
            {"equal", true},
            {"series",
             {way.series("the vehicle's way", "line", "#7fa7c9"),
              used.series("pairs in the map", "dots", "#74c08f"),
              left_out.series("pairs with too few points", "dots", "#f0705c")}}}}};
}

Json lightingParts(const RunRecord& r) {
  const auto error = [](double value) {
    return value < 0 ? std::string("-") : fixedDigits(100 * value, 1) + " %";
  };
  Json rows = Json::array();
  for (const auto& [name, l] : {std::pair("left", &r.left_lighting), std::pair("right", &r.right_lighting)})
    rows.push_back({name, lighting::nameOf(l->used), error(l->error_whole), error(l->error_plain),
                    error(l->error_range), fixedDigits(100 * l->outlier_share, 2) + " %"});
  return {
      text("The model that foretold images best, before it learnt them, corrects."),
      table({"camera", "model used", "error: whole image", "plain", "range-dependent", "samples left out"},
            rows)};
}

// Stages of a pair as table 2 of Johnson-Roberson et al. 2010 counts them.
constexpr double kReferenceSeconds = 0.47;  // a pair: stereo, fusion, simplification, meshes with texture

Json timesParts(const RunRecord& r) {
  Json stages = Json::array();
  for (const StageLine& stage : r.stages)
    stages.push_back(
        {stage.name, fixedDigits(stage.seconds, 2), std::to_string(stage.made), std::to_string(stage.there)});
  stages.push_back({"total", fixedDigits(r.total_seconds, 2), "", ""});
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
  const Json costs =
      Json::array({row("stereo (reading, light, matching, mesh)", fixedDigits(stereo, 1)),
                   row("fusion", fixedDigits(fusion, 1)), row("simplification", fixedDigits(simplify, 1)),
                   row("texture (charts, images, blending, compression)", fixedDigits(texture, 1)),
                   row("these stages", fixedDigits(same, 1)),
                   row("these stages on " + std::to_string(r.threads) + " threads",
                       fixedDigits(same / std::max(1, r.threads), 1)),
                   row("the same stages in Johnson-Roberson et al. 2010, table 2, on their machine",
                       fixedDigits(1e3 * kReferenceSeconds, 0)),
                   row("features for localisation, layers", fixedDigits(others, 1)),
                   row("peak memory of the process",
                       fixedDigits(static_cast<double>(r.peak_bytes) / 1048576.0, 0) + " MiB")});
  return {table({"stage", "seconds", "made", "there already"}, stages),
          text("Of one pair, milliseconds of one thread, as they were when the results were made:"),
          table(Json::array(), costs)};
}

Json modelParts(const RunRecord& r) {
  Json levels = Json::array();
  std::uint64_t bytes = 0;
  for (const LevelSummary& l : r.levels) {
    const auto megabytes = [](std::uint64_t b) { return fixedDigits(static_cast<double>(b) / 1e6, 2); };
    levels.push_back({std::to_string(l.level), std::to_string(l.tiles), std::to_string(l.triangles),
                      fixedDigits(l.area > 0 ? static_cast<double>(l.triangles) / l.area : 0, 0),
                      fixedDigits(1e3 * l.texel, 1), fixedDigits(1e3 * l.error, 1),
                      megabytes(l.surface_bytes), megabytes(l.picture_bytes), megabytes(l.gpu_bytes)});
    bytes += l.surface_bytes + l.picture_bytes + l.gpu_bytes;
  }
  const double megabytes_a_pair =
      static_cast<double>(bytes) / 1e6 / static_cast<double>(std::max<std::size_t>(1, r.list->pairs.size()));
  return {table({"level", "tiles", "triangles", "a m²", "texel [mm]", "error at most [mm]", "MB: surface",
                 "texture", "GPU texture"},
                levels),
          text(std::to_string(r.pieces) + " pieces; " + std::to_string(r.meshes_fused) +
               " meshes fused, counted in every piece; " + fixedDigits(megabytes_a_pair, 3) +
               " MB of tiles a pair. Digest of all files but this report: " + r.content.substr(0, 16) + ".")};
}

Json layerPictures(const std::filesystem::path& folder, const RunRecord& r) {
  Json parts = Json::array();
  for (const LayerInfo& layer : r.layers) {
    if (layer.picture.empty()) continue;
    std::ifstream in(folder / layer.picture, std::ios::binary);
    parts.push_back(picture({std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()},
                            layer.title + (layer.unit.empty() ? "" : " [" + layer.unit + "]")));
  }
  return parts;
}

Json countRows(const RunRecord& r) {
  const FuseCounts& counts = r.fused->counts;
  const Anchor& anchor = r.navigation->anchor;
  // A list of pairs of text alone would become an object.
  Json rows = Json::array(
      {row("pairs listed", r.list->pairs.size()), row("pairs in the map", counts.used),
       row("pairs outside the navigation", counts.without_pose), row("pairs unreadable", counts.unreadable),
       row("pairs with too few points", counts.too_few_points),
       row("left images without a right one", r.list->left_alone),
       row("right images without a left one", r.list->right_alone), row("corners", counts.corners),
       row("stereo points", counts.points), row("rejected: no match", counts.rejected.no_track),
       row("rejected: left-right check", counts.rejected.left_right),
       row("rejected: off the epipolar line", counts.rejected.epipolar),
       row("rejected: range", counts.rejected.range), row("rejected: outlier", counts.rejected.outlier),
       row("rejected: fish", counts.rejected.fish),
       row("bottom-track ensembles used", r.navigation->counters.dvl_used),
       row("bottom-track ensembles rejected", r.navigation->counters.dvl_rejected),
       row("anchored by", anchor.source + " (" + std::to_string(anchor.fixes_used) + " fixes, " +
                              std::to_string(anchor.fixes_rejected) + " rejected)")});
  addLocalisation(rows, r.slam);
  rows.push_back(row("mesh vertices", r.vertices));
  rows.push_back(row("mesh triangles", r.triangles));
  rows.push_back(row("work files found damaged and made again", r.damaged));
  return rows;
}

}  // namespace

void writeReportHtml(const std::filesystem::path& path, const RunRecord& r, const MapPicture& map) {
  Json sections = Json::array();
  const auto section = [&](const char* title, const Json& parts) {
    if (!parts.empty()) sections.push_back({{"title", title}, {"parts", parts}});
  };
  const auto list = [](const std::vector<std::string>& lines) {
    return lines.empty() ? Json::array() : Json::array({{{"list", lines}}});
  };
  Json warnings = Json::array();
  if (r.list->features_only)
    warnings.push_back(text("A mission without images: made from features that were matched before."));
  if (r.slam != nullptr)
    for (const std::string& warning : slamWarnings(*r.slam))
      warnings.push_back({{"text", warning}, {"strong", true}});
  section("To know", warnings);
  section("Assumed", list(r.assumed));
  section("Map", mapPictures(r, map));
  section("Track", Json::array({trackPlot(r)}));
  section("Times", timesParts(r));
  section("Model", modelParts(r));
  section("Layers", layerPictures(path.parent_path(), r));
  if (!r.list->features_only) section("Lighting", lightingParts(r));
  section("Counts", Json::array({table(Json::array(), countRows(r))}));
  section("Unreadable", list(r.fused->counts.unreadable_lines));

  const Json report{
      {"title", r.vehicle + ", dive " + std::to_string(r.dive_id)},
      {"about", r.mission + ". fathom-topside " + r.software_version + ", " +
                    std::to_string(r.fused->counts.used) + " of " + std::to_string(r.list->pairs.size()) +
                    " stereo pairs, " + fixedDigits(r.area, 1) + " m² in " + fixedDigits(r.total_seconds, 1) +
                    " s on " + std::to_string(r.threads) + " threads."},
      {"sections", sections}};
  web::writeReportPage(path, report.dump(-1, ' ', false, Json::error_handler_t::replace));
}

}  // namespace fathom::topside
