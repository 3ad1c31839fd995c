#include <algorithm>
#include <cmath>
#include <fstream>
#include <initializer_list>
#include <sstream>

#include "realtime/kernel/text.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/topside/report/html_text.hpp"
#include "recon/topside/report/report.hpp"
#include "recon/topside/report/slam_json.hpp"

namespace fathom::topside {
namespace {

constexpr const char* kStyle =
    R"(body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:70rem;padding:0 1rem;color:#1b2733}
h1{font-size:1.5rem}h2{font-size:1.15rem;margin-top:2rem}img,svg{max-width:100%;height:auto;border:1px solid #cfd8e0}
table{border-collapse:collapse}td,th{border:1px solid #cfd8e0;padding:.2rem .7rem;text-align:left}td.n{text-align:right})";

std::string base64(const std::string& bytes) {
  constexpr const char* kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t k = 0; k < bytes.size(); k += 3) {
    std::uint32_t group = 0;
    for (std::size_t b = 0; b < 3; ++b)
      group = group << 8 | (k + b < bytes.size() ? static_cast<std::uint8_t>(bytes[k + b]) : 0U);
    for (std::size_t d = 0; d < 4; ++d)
      out += k + d <= bytes.size() ? kDigits[group >> (18 - 6 * d) & 63] : '=';
  }
  return out;
}

std::string row(const std::string& name, const std::string& value) {
  return htmlRow(name, value);
}
template <typename Integer>
std::string row(const std::string& name, Integer value) {
  return htmlRow(name, std::to_string(value));
}

std::string localisationRows(const SlamResult* slam) {
  if (slam == nullptr) return row("poses", std::string("dead reckoning"));
  std::size_t removed = 0;
  for (const slam::NavigationLink& link : slam->closures) removed += link.kept ? 0 : 1;
  return row("visual odometry links", slam->odometry.size()) + row("closures tried", slam->tried.size()) +
         row("closures", slam->closures.size() - removed) + row("closures taken out again", removed) +
         row("closures left out: nothing confirmed them", slam->unconfirmed) +
         row("ground seen before, expected", fixedDigits(slam->crossings_expected, 1) + " m of way") +
         row("of it without a closure", fixedDigits(slam->crossings_unverified, 1) + " m") +
         row("moved from dead reckoning", fixedDigits(slam->moved_rms, 3) + " m rms");
}

void image(std::ostream& out, const std::vector<std::uint8_t>& rgb, const MapPicture& picture,
           const std::string& what) {
  if (rgb.empty()) return;
  out << "<figure><img alt=\"" << what << "\" src=\"data:image/png;base64,"
      << base64(toPng(rgb, picture.width, picture.height)) << "\"><figcaption>" << what
      << "</figcaption></figure>\n";
}

// The dive's track (line) and the pairs' places (dots; crossed out of the map: red), north up.
void trackPlot(std::ostream& out, const RunRecord& r) {
  Eigen::Vector2d low(INFINITY, INFINITY), high(-INFINITY, -INFINITY);
  const auto extend = [&](const SE3& pose) {
    low = low.cwiseMin(pose.translation().head<2>());
    high = high.cwiseMax(pose.translation().head<2>());
  };
  for (const NavigatedPose& p : r.navigation->track)
    if (p.T_nav_body) extend(*p.T_nav_body);
  for (const FusedPair& p : r.fused->pairs) extend(p.T_nav_body);
  if (!(high.x() >= low.x())) return;
  constexpr double kWidth = 800, kMargin = 20;  // [px]
  const double scale = (kWidth - 2 * kMargin) / std::max({high.x() - low.x(), high.y() - low.y(), 1.0});
  const auto x = [&](const SE3& p) { return kMargin + (p.translation().y() - low.y()) * scale; };
  const auto y = [&](const SE3& p) { return kMargin + (high.x() - p.translation().x()) * scale; };
  const double width = 2 * kMargin + (high.y() - low.y()) * scale,
               height = 2 * kMargin + (high.x() - low.x()) * scale;
  out << "<svg viewBox=\"0 0 " << fixedDigits(width, 0) << " " << fixedDigits(height, 0) << "\" width=\""
      << fixedDigits(width, 0) << "\"><polyline fill=none stroke=\"#7fa7c9\" points=\"";
  for (const NavigatedPose& p : r.navigation->track)
    if (p.T_nav_body)
      out << fixedDigits(x(*p.T_nav_body), 1) << "," << fixedDigits(y(*p.T_nav_body), 1) << " ";
  out << "\"/>\n";
  for (const FusedPair& p : r.fused->pairs)
    out << "<circle r=2 fill=\"" << (p.used ? "#1f6f43" : "#c0392b") << "\" cx=\""
        << fixedDigits(x(p.T_nav_body), 1) << "\" cy=\"" << fixedDigits(y(p.T_nav_body), 1) << "\"/>";
  out << "</svg><p>Track of the dive (north up, " << fixedDigits((kWidth - 2 * kMargin) / scale, 1)
      << " m across the longer side); green: pairs in the map, red: pairs with too few points.</p>\n";
}

void lightingTable(std::ostringstream& out, const RunRecord& r) {
  const auto error = [](double value) {
    return value < 0 ? std::string("-") : fixedDigits(100 * value, 1) + " %";
  };
  out << "<h2>Lighting</h2><p>The model that foretold images best, before it learnt them, "
         "corrects.</p><table>"
      << "<tr><th>camera</th><th>model used</th><th>error: whole image</th><th>plain</th>"
      << "<th>range-dependent</th><th>samples left out</th></tr>\n";
  for (const auto& [name, l] : {std::pair("left", &r.left_lighting), std::pair("right", &r.right_lighting)})
    out << "<tr><td>" << name << "</td><td>" << lighting::nameOf(l->used) << "</td><td>"
        << error(l->error_whole) << "</td><td>" << error(l->error_plain) << "</td><td>"
        << error(l->error_range) << "</td><td>" << fixedDigits(100 * l->outlier_share, 2) << " %</td></tr>\n";
  out << "</table>\n";
}

// Stages of a pair as table 2 of Johnson-Roberson et al. 2010 counts them.
constexpr double kReferenceSeconds = 0.47;  // a pair: stereo, fusion, simplification, meshes with texture

void timesTables(std::ostringstream& out, const RunRecord& r) {
  out << "<h2>Times</h2><table><tr><th>stage</th><th>seconds</th><th>made</th><th>there already</th></tr>\n";
  for (const StageLine& stage : r.stages)
    out << "<tr><td>" << stage.name << "</td><td class=n>" << fixedDigits(stage.seconds, 2)
        << "</td><td class=n>" << stage.made << "</td><td class=n>" << stage.there << "</td></tr>\n";
  out << "<tr><td>total</td><td class=n>" << fixedDigits(r.total_seconds, 2)
      << "</td><td></td><td></td></tr></table>\n";
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
  out << "<p>Of one pair, milliseconds of one thread, as they were when the results were made:</p><table>"
      << row("stereo (reading, light, matching, mesh)", fixedDigits(stereo, 1))
      << row("fusion", fixedDigits(fusion, 1)) << row("simplification", fixedDigits(simplify, 1))
      << row("texture (charts, images, blending, compression)", fixedDigits(texture, 1))
      << row("these stages", fixedDigits(same, 1))
      << row("these stages on " + std::to_string(r.threads) + " threads",
             fixedDigits(same / std::max(1, r.threads), 1))
      << row("the same stages in Johnson-Roberson et al. 2010, table 2, on their machine",
             fixedDigits(1e3 * kReferenceSeconds, 0))
      << row("features for localisation, layers", fixedDigits(others, 1))
      << row("peak memory of the process",
             fixedDigits(static_cast<double>(r.peak_bytes) / 1048576.0, 0) + " MiB")
      << "</table>\n";
}

void modelTable(std::ostringstream& out, const RunRecord& r) {
  out << "<h2>Model</h2><table><tr><th>level</th><th>tiles</th><th>triangles</th><th>a m&sup2;</th>"
         "<th>texel [mm]</th><th>error at most [mm]</th><th>MB: surface</th><th>texture</th>"
         "<th>GPU texture</th></tr>\n";
  std::uint64_t bytes = 0;
  for (const LevelSummary& l : r.levels) {
    const auto megabytes = [](std::uint64_t b) { return fixedDigits(static_cast<double>(b) / 1e6, 2); };
    out << "<tr><td class=n>" << l.level << "</td><td class=n>" << l.tiles << "</td><td class=n>"
        << l.triangles << "</td><td class=n>"
        << fixedDigits(l.area > 0 ? static_cast<double>(l.triangles) / l.area : 0, 0) << "</td><td class=n>"
        << fixedDigits(1e3 * l.texel, 1) << "</td><td class=n>" << fixedDigits(1e3 * l.error, 1)
        << "</td><td class=n>" << megabytes(l.surface_bytes) << "</td><td class=n>"
        << megabytes(l.picture_bytes) << "</td><td class=n>" << megabytes(l.gpu_bytes) << "</td></tr>\n";
    bytes += l.surface_bytes + l.picture_bytes + l.gpu_bytes;
  }
  out << "</table><p>" << r.pieces << " pieces; " << r.meshes_fused
      << " meshes fused, counted in every piece; "
      << fixedDigits(static_cast<double>(bytes) / 1e6 /
                         static_cast<double>(std::max<std::size_t>(1, r.list->pairs.size())),
                     3)
      << " MB of tiles a pair. Digest of all files but this report: " << r.content.substr(0, 16) << ".</p>\n";
}

void layerPictures(std::ostringstream& out, const std::filesystem::path& folder, const RunRecord& r) {
  if (r.layers.empty()) return;
  out << "<h2>Layers</h2>\n";
  for (const LayerInfo& layer : r.layers) {
    if (layer.picture.empty()) continue;
    std::ifstream in(folder / layer.picture, std::ios::binary);
    const std::string png{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
    const std::string what = layer.title + (layer.unit.empty() ? "" : " [" + layer.unit + "]");
    out << "<figure><img alt=\"" << markupText(what) << "\" src=\"data:image/png;base64," << base64(png)
        << "\"><figcaption>" << markupText(what) << "</figcaption></figure>\n";
  }
}

}  // namespace

void writeReportHtml(const std::filesystem::path& path, const RunRecord& r, const MapPicture& picture) {
  const FuseCounts& counts = r.fused->counts;
  std::ostringstream out;
  out << "<!doctype html><html lang=en><meta charset=utf-8><title>Fathom: " << markupText(r.vehicle)
      << " dive " << r.dive_id << "</title><style>" << kStyle << "</style>\n<h1>" << markupText(r.vehicle)
      << ", dive " << r.dive_id << "</h1><p>" << markupText(r.mission) << ". fathom-topside "
      << markupText(r.software_version) << ", " << counts.used << " of " << r.list->pairs.size()
      << " stereo pairs, " << fixedDigits(r.area, 1) << " m&sup2; in " << fixedDigits(r.total_seconds, 1)
      << " s on " << r.threads << " threads.</p>\n";
  if (r.list->features_only)
    out << "<p>A mission without images: made from features that were matched before.</p>\n";
  if (!r.assumed.empty()) {
    out << "<h2>Assumed</h2><ul>";
    for (const std::string& line : r.assumed) out << "<li>" << markupText(line) << "</li>";
    out << "</ul>\n";
  }
  if (r.slam != nullptr)
    for (const std::string& warning : slamWarnings(*r.slam))
      out << "<p><b>" << markupText(warning) << "</b></p>\n";
  out << "<h2>Map</h2>\n";
  image(out, picture.rgb, picture,
        "Depth from " + fixedDigits(picture.shallowest, 2) + " m (light) to " +
            fixedDigits(picture.deepest, 2) + " m (dark), north up, " +
            fixedDigits(picture.width * picture.metres_per_pixel, 1) + " m wide, light from the north-west");
  image(out, picture.rgb_texture, picture,
        r.list->features_only ? "Colours of the features"
                              : "Colours of the seafloor after lighting correction");
  out << "<h2>Track</h2>\n";
  trackPlot(out, r);

  timesTables(out, r);
  modelTable(out, r);
  layerPictures(out, path.parent_path(), r);

  if (!r.list->features_only) lightingTable(out, r);

  const Anchor& anchor = r.navigation->anchor;
  out << "<h2>Counts</h2><table>\n"
      << row("pairs listed", r.list->pairs.size()) << row("pairs in the map", counts.used)
      << row("pairs outside the navigation", counts.without_pose)
      << row("pairs unreadable", counts.unreadable) << row("pairs with too few points", counts.too_few_points)
      << row("left images without a right one", r.list->left_alone)
      << row("right images without a left one", r.list->right_alone) << row("corners", counts.corners)
      << row("stereo points", counts.points) << row("rejected: no match", counts.rejected.no_track)
      << row("rejected: left-right check", counts.rejected.left_right)
      << row("rejected: off the epipolar line", counts.rejected.epipolar)
      << row("rejected: range", counts.rejected.range) << row("rejected: outlier", counts.rejected.outlier)
      << row("rejected: fish", counts.rejected.fish)
      << row("bottom-track ensembles used", r.navigation->counters.dvl_used)
      << row("bottom-track ensembles rejected", r.navigation->counters.dvl_rejected)
      << row("anchored by", anchor.source + " (" + std::to_string(anchor.fixes_used) + " fixes, " +
                                std::to_string(anchor.fixes_rejected) + " rejected)")
      << localisationRows(r.slam) << row("mesh vertices", r.vertices) << row("mesh triangles", r.triangles)
      << row("work files found damaged and made again", r.damaged) << "</table>\n";
  if (!counts.unreadable_lines.empty()) {
    out << "<h2>Unreadable</h2><ul>";
    for (const std::string& line : counts.unreadable_lines) out << "<li>" << markupText(line) << "</li>";
    out << "</ul>";
  }
  out << "</html>\n";
  AtomicFile file(path);
  file.stream() << out.str();
  file.commit();
}

}  // namespace fathom::topside
