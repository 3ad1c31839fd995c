// The topside's model against the truth of a simulated mission: surface and texture, level by level; with
// --oracle, where the surface's error comes from.
#include <Eigen/Geometry>
#include <cstdio>
#include <numbers>

#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/text.hpp"
#include "tests/bench/accuracy/fusion_variants.hpp"
#include "tests/bench/accuracy/model_accuracy.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/reports.hpp"

namespace fathom::accuracy {
namespace {

using bench::cell;

constexpr double kMm = 1e3;

std::vector<bench::Table::Column> surfaceColumns(std::vector<bench::Table::Column> before) {
  for (const char* name : {"rms [mm]", "bias", "rms aligned", "bias aligned", "95 % aligned"})
    before.push_back({name, 2});
  before.push_back({"complete [%]", 1});
  before.push_back({"coverage [%]", 1});
  return before;
}

std::vector<bench::Cell> surfaceRow(std::vector<bench::Cell> before, const sim::SurfaceScore& s) {
  for (const double meters : {s.rms_m, s.bias_m, s.aligned_rms_m, s.aligned_bias_m, s.aligned_p95_m})
    before.emplace_back(kMm * meters);
  before.emplace_back(100 * s.completeness);
  before.emplace_back(100 * s.coverage);
  return before;
}

void addModel(const ModelAccuracy& model, const std::filesystem::path& out, bench::Page& page) {
  const Eigen::AngleAxisd turn(model.alignment.rotation());
  const Eigen::Vector3d t = kMm * model.alignment.translation();
  page.add({"Rigid alignment of the model onto the truth",
            {{"north [mm]", 1}, {"east [mm]", 1}, {"down [mm]", 1}, {"turn [deg]", 4}},
            {{t.x(), t.y(), t.z(), std::abs(turn.angle()) * 180 / std::numbers::pi}}});
  bench::Table surface{
      "Surface by level", surfaceColumns({{"level", 0}, {"tiles", 0}, {"triangles/m2", 1}}), {}};
  bench::Table texture{"Texture by level",
                       {{"level", 0},
                        {"texel [mm]", 2},
                        {"windows", 0},
                        {"PSNR [dB]", 2},
                        {"SSIM", 3},
                        {"correlation", 3},
                        {"shift 50 % [mm]", 2},
                        {"shift 95 %", 2},
                        {"PSNR in place", 2},
                        {"SSIM in place", 3},
                        {"gradient energy", 2}},
                       {}};
  for (const LevelAccuracy& l : model.levels) {
    surface.rows.push_back(
        surfaceRow({cell(l.level), cell(l.tiles), static_cast<double>(l.triangles) / l.area}, l.surface));
    const TextureError& e = l.texture;
    if (e.windows == 0) continue;
    texture.rows.push_back({cell(l.level), kMm * e.pixel, cell(e.windows), e.psnr, e.ssim, e.correlation,
                            kMm * e.shift_p50, kMm * e.shift_p95, e.psnr_in_place, e.ssim_in_place,
                            e.detail});
  }
  page.report().text(
      "Distances are from points spread evenly over the surface to the nearest true one; bias is positive "
      "above it; complete: true points that cameras saw with the surface within 33 mm.");
  page.add(std::move(surface));
  page.report().text(
      "Against the true albedo, turned as it is towards the eye, at the same places and the level's "
      "texel; "
      "one gain and offset a channel are fitted over the level. Shift: of a window's texture against the "
      "truth; PSNR and SSIM after it, and in place. Gradient energy: of the texture over the truth's; noise "
      "adds to it, blur takes from it.");
  page.add(std::move(texture));
  page.report().section("Model, truth, and four times their difference");
  page.report().pictureFile(out / "beside_truth.png", "From above, north up.");
  for (const LevelAccuracy& l : model.levels)
    if (l.texture.windows > 0)
      page.report().pictureFile(out / ("level_" + std::to_string(l.level) + ".png"),
                                "A window of level " + std::to_string(l.level) + ", " +
                                    decimals(kMm * l.texture.pixel, 2) + " mm a pixel.");
}

void addVariants(const VariantReport& report, bench::Page& page) {
  bench::Table fused{
      "The same pairs fused with points and poses replaced by the truth", surfaceColumns({{"", 0}}), {}};
  for (const Variant& v : report.variants) fused.rows.push_back(surfaceRow({v.name}, v.score));
  page.add(std::move(fused));
  const PointErrors& p = report.points;
  const double ratio =
      report.variants.front().score.aligned_rms_m / report.variants.at(3).score.aligned_rms_m;
  page.add({"",
            {{"ratio to the oracle", 3},
             {"stereo points", 0},
             {"rms [mm]", 2},
             {"bias [mm]", 2},
             {"rms over sigma", 2},
             {"beyond 0.1 m", 0},
             {"poses rms aligned [mm]", 2},
             {"mean edge of the meshes [mm]", 1}},
            {{ratio, cell(p.points), kMm * p.rms, kMm * p.mean, p.rms_over_sigma, cell(p.beyond_limit),
              kMm * report.pose_rms, kMm * report.triangle_edge}}});
}

void addColours(const std::filesystem::path& mission, bench::Page& page) {
  bench::Table table{"Colours against the true albedo: CIEDE2000 after one white balance, by squares of 5 cm",
                     {{"", 0},
                      {"median", 2},
                      {"95 %", 2},
                      {"chroma", 2},
                      {"correlated with depth", 2},
                      {"range", 2},
                      {"squares", 0}},
                     {}};
  for (const auto& [name, c] : sim::scoreMission(mission).colours)
    table.rows.push_back(
        {name, c.median, c.p95, c.chroma, c.with_depth, c.with_range, cell(c.squares.size())});
  if (!table.rows.empty()) page.add(std::move(table));
}

struct Options {
  std::filesystem::path mission, results, out, config;
  bool oracle = false, no_model = false;
  int features = 0;
};

int run(Options o) {
  if (o.results.empty()) o.results = o.mission / "topside";
  if (!o.out.empty()) std::filesystem::create_directories(o.out);
  bench::Page page("Accuracy: " + o.mission.string());
  if (!o.no_model) addModel(measureModel(o.mission, o.results, o.out), o.out, page);
  // The score reads what lies in the mission's own folders.
  if (o.results == o.mission / "topside") addColours(o.mission, page);
  if (o.oracle) {
    auto config = o.config.empty() ? topside::TopsideConfig{} : topside::readTopsideConfig(o.config);
    if (o.features > 0) config.stereo.max_features = o.features;
    addVariants(fuseVariants(o.mission, o.results / "stereo_pose_est.data", config), page);
  }
  std::printf("%s", page.text().c_str());
  if (!o.out.empty()) page.write(o.out, "accuracy");
  return kExitSuccess;
}

}  // namespace
}  // namespace fathom::accuracy

namespace fathom::bench {

test::Report accuracyReport() {
  static accuracy::Options o;
  return {"accuracy",
          "The topside's model against the truth of a simulated mission: surface, texture and colours",
          {required({"mission", &o.mission, "simulated mission"}),
           {"--results", &o.results, "folder of fathom-topside (MISSION/topside)"},
           {"--out", &o.out, "folder that gets accuracy.html, accuracy.json and pictures"},
           {"--oracle", &o.oracle, "also fuse with points and poses replaced by the truth"},
           {"--no-model", &o.no_model, "leave the tiles out"},
           {"--config", &o.config, "of --oracle: TOML file of fathom-topside run"},
           {"--features", &o.features, "of --oracle: corners wanted in an image; 0: the configuration's", 0,
            5000}},
          [] { return accuracy::run(o); }};
}

}  // namespace fathom::bench
