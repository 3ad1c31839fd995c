#include "tests/bench/accuracy/accuracy_page.hpp"

#include <Eigen/Geometry>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numbers>

#include "recon/topside/report/html_text.hpp"

namespace fathom::accuracy {
namespace {

using Json = nlohmann::ordered_json;
using topside::fixedDigits;

constexpr double kMm = 1e3;

Json toJson(const sim::SurfaceScore& s) {
  return {{"rms_m", s.rms_m},
          {"bias_m", s.bias_m},
          {"aligned_rms_m", s.aligned_rms_m},
          {"aligned_bias_m", s.aligned_bias_m},
          {"aligned_p95_m", s.aligned_p95_m},
          {"coverage", s.coverage},
          {"completeness", s.completeness}};
}

Json toJson(const TextureError& t) {
  if (t.windows == 0) return nullptr;
  return {{"windows", t.windows},
          {"pixel_m", t.pixel},
          {"shift_p50_m", t.shift_p50},
          {"shift_p95_m", t.shift_p95},
          {"psnr_db", t.psnr},
          {"ssim", t.ssim},
          {"correlation", t.correlation},
          {"psnr_in_place_db", t.psnr_in_place},
          {"ssim_in_place", t.ssim_in_place},
          {"gradient_energy", t.detail}};
}

std::string cells(std::initializer_list<std::string> values) {
  std::string row;
  for (const std::string& v : values) row += "<td class=n>" + v + "</td>";
  return row + "</tr>\n";
}

std::string alignmentText(const SE3& motion) {
  const Eigen::AngleAxisd turn(motion.rotation());
  const Eigen::Vector3d t = kMm * motion.translation();
  return "north " + fixedDigits(t.x(), 1) + ", east " + fixedDigits(t.y(), 1) + ", down " +
         fixedDigits(t.z(), 1) + " mm, turned by " +
         fixedDigits(std::abs(turn.angle()) * 180 / std::numbers::pi, 4) + " deg";
}

double ratio(const VariantReport& v) {
  return v.variants.front().score.aligned_rms_m / v.variants.at(3).score.aligned_rms_m;
}

}  // namespace

std::string toJson(const AccuracyReport& report) {
  Json json;
  json["mission"] = report.mission;
  if (report.model) {
    const Eigen::AngleAxisd turn(report.model->alignment.rotation());
    const Eigen::Vector3d t = report.model->alignment.translation();
    json["alignment"] = {{"north_m", t.x()},
                         {"east_m", t.y()},
                         {"down_m", t.z()},
                         {"turn_deg", std::abs(turn.angle()) * 180 / std::numbers::pi}};
    for (const LevelAccuracy& l : report.model->levels)
      json["levels"].push_back({{"level", l.level},
                                {"tiles", l.tiles},
                                {"triangles_per_m2", static_cast<double>(l.triangles) / l.area},
                                {"surface", toJson(l.surface)},
                                {"texture", toJson(l.texture)}});
  }
  if (report.variants) {
    Json& oracle = json["oracle"];
    for (const Variant& v : report.variants->variants) {
      Json row = {{"name", v.name}};
      row.update(toJson(v.score));
      oracle["surfaces"].push_back(row);
    }
    oracle["ratio"] = ratio(*report.variants);
    const PointErrors& p = report.variants->points;
    oracle["points"] = {{"count", p.points},
                        {"beyond_0.1_m", p.beyond_limit},
                        {"rms_m", p.rms},
                        {"bias_m", p.mean},
                        {"rms_over_sigma", p.rms_over_sigma}};
    oracle["pose_rms_m"] = report.variants->pose_rms;
    oracle["triangle_edge_m"] = report.variants->triangle_edge;
  }
  return json.dump(2) + "\n";
}

std::string toText(const AccuracyReport& report) {
  std::string out;
  char line[240];
  if (report.model) {
    out += "alignment: " + alignmentText(report.model->alignment) + "\n";
    std::snprintf(line, sizeof line, "%5s %7s %9s | %8s %8s %8s %8s %9s | %8s %7s %6s %6s %8s %9s\n", "level",
                  "tiles", "tri/m2", "rms[mm]", "bias", "aligned", "p95", "complete", "texel", "PSNR", "SSIM",
                  "corr", "shift", "gradients");
    out += line;
    for (const LevelAccuracy& l : report.model->levels) {
      std::snprintf(
          line, sizeof line,
          "%5d %7zu %9.1f | %8.2f %8.2f %8.2f %8.2f %8.1f%% | %8.2f %7.2f %6.3f %6.3f %8.2f %9.2f\n", l.level,
          l.tiles, static_cast<double>(l.triangles) / l.area, kMm * l.surface.rms_m, kMm * l.surface.bias_m,
          kMm * l.surface.aligned_rms_m, kMm * l.surface.aligned_p95_m, 100 * l.surface.completeness,
          kMm * l.texture.pixel, l.texture.psnr, l.texture.ssim, l.texture.correlation,
          kMm * l.texture.shift_p50, l.texture.detail);
      out += line;
    }
  }
  if (!report.variants) return out;
  std::snprintf(line, sizeof line, "%-34s %8s %8s | %9s %7s %7s  complete  coverage\n", "[mm]", "rms", "bias",
                "aligned", "bias", "p95");
  out += line;
  for (const Variant& v : report.variants->variants) {
    const sim::SurfaceScore& s = v.score;
    std::snprintf(line, sizeof line, "%-34s %8.2f %8.2f | %9.2f %7.2f %7.2f   %5.1f%%   %5.1f%%\n",
                  v.name.c_str(), kMm * s.rms_m, kMm * s.bias_m, kMm * s.aligned_rms_m,
                  kMm * s.aligned_bias_m, kMm * s.aligned_p95_m, 100 * s.completeness, 100 * s.coverage);
    out += line;
  }
  const PointErrors& p = report.variants->points;
  std::snprintf(
      line, sizeof line,
      "ratio to the oracle: %.3f\nstereo points: %zu, rms %.2f mm, bias %.2f mm, %.2f of their sigma; "
      "%zu beyond 0.1 m\nposes: %.2f mm rms aligned; triangles: %.1f mm mean edge\n",
      ratio(*report.variants), p.points, kMm * p.rms, kMm * p.mean, p.rms_over_sigma, p.beyond_limit,
      kMm * report.variants->pose_rms, kMm * report.variants->triangle_edge);
  return out + line;
}

std::string toHtml(const AccuracyReport& report) {
  std::string html = topside::htmlHead("Accuracy: " + report.mission);
  if (report.model) {
    html += "<p>Rigid alignment of the model onto the truth: " + alignmentText(report.model->alignment) +
            ". Distances are from points spread evenly over the surface to the nearest true one; bias is "
            "positive above "
            "it; complete: true points that cameras saw with the surface within 33 mm.</p>\n";
    html +=
        "<h2>Surface by level "
        "[mm]</h2><table><tr><th>level</th><th>tiles</th><th>triangles/m2</th><th>RMS</th>"
        "<th>bias</th><th>RMS aligned</th><th>bias aligned</th><th>95 % aligned</th><th>complete [%]</th>"
        "<th>coverage [%]</th></tr>\n";
    for (const LevelAccuracy& l : report.model->levels) {
      const sim::SurfaceScore& s = l.surface;
      html += "<tr>" +
              cells({std::to_string(l.level), std::to_string(l.tiles),
                     fixedDigits(static_cast<double>(l.triangles) / l.area, 1), fixedDigits(kMm * s.rms_m, 2),
                     fixedDigits(kMm * s.bias_m, 2), fixedDigits(kMm * s.aligned_rms_m, 2),
                     fixedDigits(kMm * s.aligned_bias_m, 2), fixedDigits(kMm * s.aligned_p95_m, 2),
                     fixedDigits(100 * s.completeness, 1), fixedDigits(100 * s.coverage, 1)});
    }
    html +=
        "</table>\n<h2>Texture by level</h2><p>Against the true albedo, turned as it is towards the eye, at "
        "the same "
        "places and the level's texel; one gain and offset a channel are fitted over the level. Shift: of a "
        "window's "
        "texture against the truth; PSNR and SSIM after it, and in place. Gradient energy: of the texture "
        "over the "
        "truth's; noise adds to it, blur takes from it.</p>\n<table><tr><th>level</th><th>texel "
        "[mm]</th><th>windows</th><th>PSNR [dB]</th><th>SSIM</th>"
        "<th>correlation</th><th>shift 50 % [mm]</th><th>95 %</th><th>PSNR in place</th><th>SSIM in "
        "place</th>"
        "<th>gradient energy</th></tr>\n";
    for (const LevelAccuracy& l : report.model->levels) {
      const TextureError& t = l.texture;
      if (t.windows == 0) continue;
      html += "<tr>" + cells({std::to_string(l.level), fixedDigits(kMm * t.pixel, 2),
                              std::to_string(t.windows), fixedDigits(t.psnr, 2), fixedDigits(t.ssim, 3),
                              fixedDigits(t.correlation, 3), fixedDigits(kMm * t.shift_p50, 2),
                              fixedDigits(kMm * t.shift_p95, 2), fixedDigits(t.psnr_in_place, 2),
                              fixedDigits(t.ssim_in_place, 3), fixedDigits(t.detail, 2)});
    }
    html +=
        "</table>\n<h2>Model, truth, and four times their difference</h2><figure><img src=beside_truth.png "
        "style='max-width:100%'><figcaption>From above, north up.</figcaption></figure>\n";
    for (const LevelAccuracy& l : report.model->levels)
      if (l.texture.windows > 0)
        html += "<figure><img src=level_" + std::to_string(l.level) +
                ".png style='max-width:100%'><figcaption>A window of level " + std::to_string(l.level) +
                ", " + fixedDigits(kMm * l.texture.pixel, 2) + " mm a pixel.</figcaption></figure>\n";
  }
  if (report.variants) {
    html +=
        "<h2>Where the surface's error comes from [mm]</h2><p>The same pairs fused with points and poses "
        "replaced by "
        "the truth. Ratio to the oracle: " +
        fixedDigits(ratio(*report.variants), 3) +
        "</p><table><tr><th></th><th>RMS</th><th>bias</th><th>RMS aligned</th><th>bias aligned</th><th>95 % "
        "aligned</th><th>complete [%]</th></tr>\n";
    for (const Variant& v : report.variants->variants) {
      const sim::SurfaceScore& s = v.score;
      html += "<tr><td>" + v.name + "</td>" +
              cells({fixedDigits(kMm * s.rms_m, 2), fixedDigits(kMm * s.bias_m, 2),
                     fixedDigits(kMm * s.aligned_rms_m, 2), fixedDigits(kMm * s.aligned_bias_m, 2),
                     fixedDigits(kMm * s.aligned_p95_m, 2), fixedDigits(100 * s.completeness, 1)});
    }
    html += "</table>\n<table>";
    const PointErrors& p = report.variants->points;
    html += topside::htmlRow("stereo points", std::to_string(p.points));
    html += topside::htmlRow("their RMS along the line of sight [mm]", fixedDigits(kMm * p.rms, 2));
    html += topside::htmlRow("their bias [mm]", fixedDigits(kMm * p.mean, 2));
    html += topside::htmlRow("RMS over what they claim", fixedDigits(p.rms_over_sigma, 2));
    html += topside::htmlRow("beyond 0.1 m", std::to_string(p.beyond_limit));
    html += topside::htmlRow("poses, RMS aligned [mm]", fixedDigits(kMm * report.variants->pose_rms, 2));
    html += topside::htmlRow("mean edge of the local meshes [mm]",
                             fixedDigits(kMm * report.variants->triangle_edge, 1));
    html += "</table>\n";
  }
  return html;
}

}  // namespace fathom::accuracy
