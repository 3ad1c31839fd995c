#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "realtime/kernel/command_line.hpp"
#include "recon/geometry/tile_grid.hpp"
#include "recon/surface/texture_measures.hpp"
#include "recon/surface/view_projection.hpp"
#include "tests/bench/texture/multi_band_peer.hpp"
#include "tests/bench/texture/textured_survey.hpp"

// Texture of a mission's tiles, mode by mode: time, seams, detail, pictures side by side.
namespace fathom::surface {
namespace {

struct Options {
  std::string mission, model, out = ".";
  double texel = 0.0012, triangles_per_m2 = 1000, north = 0, east = 0, tile_edge = 2.112;
  int tiles = 1, peer_views = 12;
  std::vector<double> sharpness;
  bool no_vote = false, peer = false;
};

// Of this thread [s]: other programs on the machine do not count.
double now() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// Sums over tiles for one way of blending.
struct Row {
  const char* name;
  SeamMeasure seams;
  double detail = 0, detail_weight = 0;  // energy against the sharpest single image, weighted by texels
  double seconds = 0;
};

// Regions between which an image's border runs: the view shown when unblended, and which views see the texel
// at all (so that the average's borders count too).
std::vector<std::uint64_t> regionsOf(const Atlas& atlas, const ViewIndex& index, const Camera& camera,
                                     const std::vector<std::uint32_t>& places,
                                     const std::vector<std::uint32_t>& chosen) {
  std::vector<std::uint64_t> region(chosen.size(), kNoRegion);
  std::vector<Texel> texels;
  std::vector<ViewProjection> views;
  for (const std::uint32_t place : places)
    views.emplace_back(camera, index.views()[place].T_nav_cam, Eigen::Vector3d::Zero());
  constexpr int kRows = 64;
  for (int first = 0; first < atlas.height; first += kRows) {
    const int rows = std::min(kRows, atlas.height - first);
    rasterise(atlas, first, rows, texels);
    for (std::size_t i = 0; i < texels.size(); ++i) {
      const std::size_t at = i + static_cast<std::size_t>(first) * static_cast<std::size_t>(atlas.width);
      if (texels[i].face < 0 || chosen[at] == kNoView) continue;
      std::uint64_t hash = 1469598103934665603ULL ^ chosen[at];
      for (std::size_t v = 0; v < views.size(); ++v) {
        const auto& p = texels[i].point;
        const auto pixel = views[v].project(p.x(), p.y(), p.z());
        const bool inside = pixel.valid && pixel.u >= 0 && pixel.v >= 0 && pixel.u <= views[v].width - 1 &&
                            pixel.v <= views[v].height - 1;
        hash = (hash ^ (inside ? 2 * v + 3 : 1)) * 1099511628211ULL;
      }
      region[at] = hash | 1;
    }
  }
  return region;
}

// The tile from above, north up: of the texels over a place the highest.
RgbImage fromAbove(const Atlas& atlas, const RgbImage& texture, const std::array<double, 4>& box,
                   double texel) {
  const auto side = static_cast<int>((box[2] - box[0]) / texel);
  RgbImage out{
      side, side,
      std::vector<std::uint8_t>(3 * static_cast<std::size_t>(side) * static_cast<std::size_t>(side))};
  std::vector<float> depth(out.rgb.size() / 3, 1e9F);
  std::vector<Texel> texels;
  rasterise(atlas, 0, atlas.height, texels);
  for (std::size_t i = 0; i < texels.size(); ++i) {
    const Eigen::Vector3f& p = texels[i].point;
    const int x = static_cast<int>((p.y() - box[1]) / texel),
              y = side - 1 - static_cast<int>((p.x() - box[0]) / texel);
    if (texels[i].face < 0 || x < 0 || y < 0 || x >= side || y >= side) continue;
    const std::size_t at =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(side) + static_cast<std::size_t>(x);
    if (p.z() >= depth[at]) continue;
    depth[at] = p.z();
    std::copy_n(&texture.rgb[3 * i], 3, &out.rgb[3 * at]);
  }
  return out;
}

// Side by side: whole tiles shrunk to one height, and below them their middles texel by texel.
void writeComparison(const std::string& path, const std::vector<RgbImage>& images) {
  constexpr int kSide = 640;
  cv::Mat all(2 * kSide, static_cast<int>(images.size()) * kSide, CV_8UC3, cv::Scalar(0, 0, 0));
  for (std::size_t k = 0; k < images.size(); ++k) {
    const RgbImage& image = images[k];
    cv::Mat bgr, small;
    cv::cvtColor(cv::Mat(image.height, image.width, CV_8UC3, const_cast<std::uint8_t*>(image.rgb.data())),
                 bgr, cv::COLOR_RGB2BGR);
    const double scale = static_cast<double>(kSide) / std::max(image.width, image.height);
    cv::resize(bgr, small, {}, scale, scale, cv::INTER_AREA);
    const int x = static_cast<int>(k) * kSide;
    small.copyTo(all(cv::Rect(x, 0, small.cols, small.rows)));
    const cv::Rect crop(std::max(0, image.width / 2 - kSide / 2), std::max(0, image.height / 2 - kSide / 2),
                        std::min(kSide, image.width), std::min(kSide, image.height));
    bgr(crop).copyTo(all(cv::Rect(x, kSide, crop.width, crop.height)));
  }
  cv::imwrite(path, all);
}

class Report {
 public:
  explicit Report(const Options& options)
      : options_(options),
        survey_(options.mission, options.model.empty() ? options.mission + "/topside" : options.model) {
    plain_ = [this](std::uint32_t image) { return survey_.bandsOf(image, {.restore = false}); };
    source_ = [this](std::uint32_t image) { return survey_.bandsOf(image, config_.bands); };
    config_.vote = !options.no_vote;
    if (options.sharpness.size() == 3) std::copy_n(options.sharpness.begin(), 3, config_.sharpness.begin());
  }

  void run() {
    const int side = std::max(1, static_cast<int>(std::ceil(std::sqrt(options_.tiles))));
    for (int k = 0; k < options_.tiles; ++k) tile(k, k / side, k % side);
    print();
  }

 private:
  void tile(int number, int row, int column) {
    const double edge = options_.tile_edge;
    const std::array<double, 4> box{options_.north + row * edge, options_.east + column * edge,
                                    options_.north + (row + 1) * edge, options_.east + (column + 1) * edge};
    const TileMesh mesh = survey_.tileAt(box, options_.triangles_per_m2);
    if (mesh.mesh.empty()) return;
    const Mesh around = survey_.tileAt({box[0] - edge, box[1] - edge, box[2] + edge, box[3] + edge}, 0).mesh;
    double start = now();
    Atlas atlas = makeAtlas(mesh, {options_.texel, 4096, 4});
    atlas_seconds_ += now() - start;
    const auto places = survey_.index().meeting(box);
    for (const std::uint32_t place : places) (void)source_(survey_.index().views()[place].image);

    // `single`: an image by itself, plainly interpolated.
    const auto textured = [&](BlendMode mode, const std::vector<std::uint32_t>& from, double* seconds,
                              bool single = false) {
      BlendConfig config = config_;
      config.mode = mode;
      TextureBlender blender(survey_.camera(), config);
      const double begun = now();
      counts_ = blender.blend(atlas, survey_.index(), from, {&around}, single ? plain_ : source_);
      if (seconds != nullptr) *seconds += now() - begun;
      chosen_ = blender.chosen();
      return atlas.tile.atlas;
    };
    std::vector<RgbImage> images;
    images.push_back(textured(BlendMode::kUnblended, places, &rows_[0].seconds));
    const std::vector<std::uint32_t> shown = chosen_;
    images.push_back(textured(BlendMode::kAverage, places, &rows_[1].seconds));
    images.push_back(textured(BlendMode::kBands, places, &rows_[2].seconds));
    const BlendCounts counts = counts_;
    texels_ += counts.texels;
    std::printf(
        "tile %d: %dx%d atlas, %zu charts, %lu texels, %u views, %.2f %% unseen, %lu hidden, %lu voted out,"
        " %.2f views a texel in the high band\n",
        number, atlas.width, atlas.height, atlas.charts.size(), counts.texels, counts.views,
        100.0 * static_cast<double>(counts.unseen) / static_cast<double>(counts.texels), counts.occluded,
        counts.outvoted, static_cast<double>(counts.samples) / static_cast<double>(counts.texels));
    const auto region = regionsOf(atlas, survey_.index(), survey_.camera(), places, shown);

    // Every view by itself.
    std::vector<RgbImage> layers;
    std::vector<std::vector<std::uint8_t>> seen;
    std::vector<std::uint64_t> peer_region(shown.size(), 0);
    std::vector<std::uint32_t> users = shown;
    std::sort(users.begin(), users.end());
    users.erase(std::unique(users.begin(), users.end()), users.end());
    std::erase(users, kNoView);
    for (const std::uint32_t place : users) {
      layers.push_back(textured(BlendMode::kUnblended, {place}, nullptr, true));
      seen.emplace_back(shown.size());
      for (std::size_t i = 0; i < shown.size(); ++i)
        seen.back()[i] = chosen_[i] != kNoView && region[i] != kNoRegion;
      for (std::size_t i = 0; i < shown.size(); ++i)
        if (shown[i] == place) peer_region[i] = layers.size();
    }
    if (options_.peer) {
      start = now();
      images.push_back(multiBandPeer(layers, seen, peer_region));
      rows_[3].seconds += now() - start;
    }
    for (std::size_t k = 0; k < images.size(); ++k) {
      rows_[k].seams += measureSeams(images[k], region);
      std::optional<double> least;
      for (std::size_t v = 0; v < layers.size(); ++v) {
        const GradientEnergy single = gradientEnergy(layers[v], seen[v]);
        if (single.texels < counts.texels / 5) continue;  // a corner of the tile says little
        const double ratio = gradientEnergy(images[k], seen[v]).mean() / single.mean();
        least = std::min(least.value_or(ratio), ratio);
      }
      if (!least) continue;
      rows_[k].detail += *least * static_cast<double>(counts.texels);
      rows_[k].detail_weight += static_cast<double>(counts.texels);
    }
    std::vector<RgbImage> pictures;
    for (const RgbImage& image : images)
      pictures.push_back(fromAbove(atlas, image, box, 1.3 * atlas.tile.texel));
    writeComparison(options_.out + "/tile" + std::to_string(number) + ".png", pictures);
  }

  void print() const {
    std::printf("%lu texels; an atlas %.1f ms a million; an image read %.1f ms, its bands %.1f ms\n", texels_,
                1e3 * atlas_seconds_ / (static_cast<double>(texels_) / 1e6),
                1e3 * survey_.readSeconds() / static_cast<double>(survey_.imagesMade()),
                1e3 * survey_.bandSeconds() / static_cast<double>(survey_.imagesMade()));
    std::printf("%-28s %10s %10s %8s %8s %14s\n", "", "across", "inside", "ratio", "detail", "ms/M texel");
    for (const Row& row : rows_) {
      if (row.seams.pairs_inside == 0) continue;
      std::printf("%-28s %10.3f %10.3f %8.3f %8.3f %14.1f\n", row.name, row.seams.across, row.seams.inside,
                  row.seams.ratio(), row.detail / row.detail_weight,
                  1e3 * row.seconds / (static_cast<double>(texels_) / 1e6));
    }
  }

  Options options_;
  TexturedSurvey survey_;
  BlendConfig config_;
  TextureBlender::BandSource source_, plain_;
  BlendCounts counts_;
  std::vector<std::uint32_t> chosen_;
  std::array<Row, 4> rows_{
      {{"unblended", {}}, {"average", {}}, {"three bands", {}}, {"OpenCV MultiBandBlender", {}}}};
  std::uint64_t texels_ = 0;
  double atlas_seconds_ = 0;
};

}  // namespace
}  // namespace fathom::surface

int main(int argc, char** argv) {
  CLI::App app("Textures tiles of a mission that fathom-topside has been over, mode by mode");
  fathom::surface::Options options;
  app.add_option("mission", options.mission)->required();
  app.add_option("--model", options.model, "folder with mesh.ply and the pose files; MISSION/topside");
  app.add_option("--out", options.out, "folder for the pictures");
  app.add_option("--tiles", options.tiles);
  app.add_option("--north", options.north, "of the first tile [m]");
  app.add_option("--east", options.east, "of the first tile [m]");
  app.add_option("--texel", options.texel, "[m]");
  app.add_option("--sharpness", options.sharpness, "k of the low, middle and high band")->expected(3);
  app.add_flag("--no-vote", options.no_vote);
  app.add_flag("--peer", options.peer, "OpenCV's blender beside");
  if (const auto code = fathom::parseCommandLine("report_texture", app, argc, argv)) return *code;
  return fathom::runTool("report_texture", [&] {
    fathom::surface::Report(options).run();
    return 0;
  });
}
