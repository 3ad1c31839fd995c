// Where the error of the topside's surface comes from: the same pairs fused with stereo's points and poses
// replaced by the truth, one after the other.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "tests/bench/accuracy/fusion_variants.hpp"

namespace fathom::accuracy {
namespace {

using Json = nlohmann::ordered_json;

Json toJson(const VariantReport& report) {
  Json json;
  for (const Variant& v : report.variants) {
    const sim::SurfaceScore& s = v.score;
    json["surfaces"].push_back({{"name", v.name},
                                {"rms_m", s.rms_m},
                                {"bias_m", s.bias_m},
                                {"aligned_rms_m", s.aligned_rms_m},
                                {"aligned_bias_m", s.aligned_bias_m},
                                {"aligned_p95_m", s.aligned_p95_m},
                                {"coverage", s.coverage},
                                {"completeness", s.completeness},
                                {"triangles", v.mesh.triangles.size()}});
  }
  json["oracle_ratio"] = report.variants.front().score.aligned_rms_m / report.variants[3].score.aligned_rms_m;
  json["points"] = {{"count", report.points.points},
                    {"beyond_0.1_m", report.points.beyond_limit},
                    {"rms_m", report.points.rms},
                    {"bias_m", report.points.mean},
                    {"rms_over_sigma", report.points.rms_over_sigma}};
  json["pose_rms_m"] = report.pose_rms;
  json["triangle_edge_m"] = report.triangle_edge;
  return json;
}

void print(const VariantReport& report) {
  std::printf("%-34s %8s %8s | aligned: %7s %7s %7s  complete  coverage\n", "[mm]", "rms", "bias", "rms",
              "bias", "p95");
  for (const Variant& v : report.variants) {
    const sim::SurfaceScore& s = v.score;
    std::printf("%-34s %8.2f %8.2f |          %7.2f %7.2f %7.2f   %5.1f%%   %5.1f%%\n", v.name.c_str(),
                1e3 * s.rms_m, 1e3 * s.bias_m, 1e3 * s.aligned_rms_m, 1e3 * s.aligned_bias_m,
                1e3 * s.aligned_p95_m, 100 * s.completeness, 100 * s.coverage);
  }
  const PointErrors& p = report.points;
  std::printf(
      "stereo points: %zu, rms %.2f mm, bias %.2f mm, %.2f of their sigma; %.3f%% beyond 0.1 m\n"
      "poses: %.2f mm rms aligned; triangles: %.1f mm mean edge\n",
      p.points, 1e3 * p.rms, 1e3 * p.mean, p.rms_over_sigma,
      100.0 * static_cast<double>(p.beyond_limit) / static_cast<double>(std::max<std::size_t>(p.points, 1)),
      1e3 * report.pose_rms, 1e3 * report.triangle_edge);
}

}  // namespace
}  // namespace fathom::accuracy

int main(int argc, char** argv) {
  CLI::App app("The topside's surface against the truth of a simulated mission, and where its error is from");
  std::filesystem::path mission, poses, out, config_file;
  int features = 0;
  app.add_option("mission", mission, "simulated mission with images")->required();
  app.add_option("--poses", poses, "stereo_pose_est.data (MISSION/topside/stereo_pose_est.data)");
  app.add_option("--config", config_file, "TOML file of fathom-topside run");
  app.add_option("--features", features, "corners wanted in an image")->check(CLI::Range(20, 5000));
  app.add_option("--out", out, "JSON file to write");
  if (const auto code = fathom::parseCommandLine("report_accuracy", app, argc, argv)) return *code;
  return fathom::runTool("report_accuracy", [&]() -> int {
    using namespace fathom::accuracy;
    fathom::topside::TopsideConfig config = config_file.empty()
                                                ? fathom::topside::TopsideConfig{}
                                                : fathom::topside::readTopsideConfig(config_file);
    if (features > 0) config.stereo.max_features = features;
    if (poses.empty()) poses = mission / "topside" / "stereo_pose_est.data";
    const VariantReport report = fuseVariants(mission, poses, config);
    print(report);
    if (!out.empty()) {
      fathom::AtomicFile file(out);
      file.stream() << toJson(report).dump(2) << "\n";
      file.commit();
    }
    return fathom::kExitSuccess;
  });
}
