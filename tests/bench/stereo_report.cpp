// Stereo against the truth of simulated missions, and against OpenCV in the same run: depth and disparity
// errors, errors over the stated sigma, and height error over the number of features (figure 6 of
// Johnson-Roberson et al. 2010). Times over features: fathom-bench --benchmark_filter=stereo. Writes
// stereo.html and stereo.json.
#include <cstdio>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/stereo/delaunay.hpp"
#include "recon/stereo/dense_stereo.hpp"
#include "tests/bench/common/opencv_stereo.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/reports.hpp"
#include "tests/bench/stereo_accuracy.hpp"

namespace fathom::stereo {
namespace {

using bench::cell, bench::TrueMission, bench::viewOf;

constexpr int kFeatures[] = {200, 400, 800, 1200, 2000, 3000, 4000, 5000};
constexpr int kReference = 5000;  // features of the mesh that heights are compared with
constexpr int kStep = 8;          // of the depth images [px]

std::vector<float> depthOf(const StereoResult& r, int width, int height) {
  std::vector<Eigen::Vector2d> pixels;
  std::vector<double> depth;
  for (const StereoPoint& p : r.points) {
    pixels.push_back(p.left.cast<double>());
    depth.push_back(static_cast<double>(p.point.z()));
  }
  return depthImage(pixels, depth, r.triangles, width, height, kStep);
}

// With the triangles that they would have in the left image.
StereoResult resultOf(const OpenCvStereo& peer) {
  StereoResult r;
  std::vector<Delaunay::Point> lattice;
  for (std::size_t i = 0; i < peer.points.size(); ++i) {
    r.points.emplace_back();
    r.points.back().left = {peer.left[i].x, peer.left[i].y};
    r.points.back().right = {peer.right[i].x, peer.right[i].y};
    r.points.back().point = peer.points[i].cast<float>();
    lattice.push_back({static_cast<std::int32_t>(std::lround(peer.left[i].x)),
                       static_cast<std::int32_t>(std::lround(peer.left[i].y))});
  }
  Delaunay delaunay;
  r.triangles = delaunay.triangulate(lattice);
  return r;
}

struct SweepRow {
  int features = 0;
  double points = 0, peer_points = 0;          // means over the pairs
  double height_rms = 0, peer_height_rms = 0;  // against each one's own mesh of 5000 features [m]
  double truth_rms = 0, peer_truth_rms = 0;    // against the true surface [m]
};

struct MissionReport {
  std::string name;
  StereoRig rig;
  std::size_t pairs = 0;
  std::vector<PointError> sparse, dense;
  Accuracy peer;
  std::vector<SweepRow> sweep;
  double sigma_disparity = 0;  // root mean square of the disparity errors below 1 px [px]
};

std::vector<float> trueDepth(const TrueMission& mission, std::size_t pair) {
  std::vector<float> image;
  for (int y = 0; y < mission.rig().left.height; y += kStep)
    for (int x = 0; x < mission.rig().left.width; x += kStep) {
      const auto p = mission.pointAt(pair, {x, y});
      image.push_back(p ? static_cast<float>(p->z()) : 0.0F);
    }
  return image;
}

void sweepPair(const TrueMission& mission, std::size_t pair, const TrueMission::Images& images, double share,
               std::vector<SweepRow>& rows) {
  const int width = images.left.cols, height = images.left.rows;
  const ImageView left = viewOf(images.left), right = viewOf(images.right);
  const SeedPlane& plane = mission.pairs()[pair].plane;
  const std::vector<float> truth = trueDepth(mission, pair);
  SparseStereoConfig config{.max_features = kReference};
  SparseStereo reference(mission.rig(), config);
  const std::vector<float> best = depthOf(reference.process(left, right, plane), width, height);
  OpenCvStereo peer(mission.rig());
  peer.process(images.left, images.right, plane, kReference);
  const std::vector<float> peer_best = depthOf(resultOf(peer), width, height);
  for (std::size_t k = 0; k < std::size(kFeatures); ++k) {
    SweepRow& row = rows[k];
    row.features = kFeatures[k];
    config.max_features = row.features;
    SparseStereo stereo(mission.rig(), config);
    const StereoResult& result = stereo.process(left, right, plane);
    row.points += share * static_cast<double>(result.points.size());
    const std::vector<float> depth = depthOf(result, width, height);
    row.height_rms += share * rmsDifference(depth, best);
    row.truth_rms += share * rmsDifference(depth, truth);

    peer.process(images.left, images.right, plane, row.features);
    row.peer_points += share * static_cast<double>(peer.points.size());
    const std::vector<float> peer_depth = depthOf(resultOf(peer), width, height);
    row.peer_height_rms += share * rmsDifference(peer_depth, peer_best);
    row.peer_truth_rms += share * rmsDifference(peer_depth, truth);
  }
}

MissionReport measure(const std::filesystem::path& folder, std::size_t wanted, std::size_t sweep_pairs) {
  const TrueMission mission(folder);
  MissionReport report;
  report.name = folder.filename().string();
  report.rig = mission.rig();
  report.pairs = std::min(wanted, mission.pairs().size());
  report.sweep.resize(std::size(kFeatures));
  SparseStereo sparse(mission.rig(), {});
  DenseStereo dense(mission.rig(), {}, {});
  OpenCvStereo peer(mission.rig());
  std::vector<PointError> peer_errors;
  const std::size_t sweeps = std::min(sweep_pairs, report.pairs);
  for (std::size_t k = 0; k < report.pairs; ++k) {
    const std::size_t pair = k * mission.pairs().size() / report.pairs;
    const TrueMission::Images images = mission.corrected(pair);
    const SeedPlane& plane = mission.pairs()[pair].plane;
    const ImageView left = viewOf(images.left), right = viewOf(images.right);
    addErrors(mission, pair, sparse.process(left, right, plane), report.sparse);
    addErrors(mission, pair, dense.process(left, right, plane), report.dense);
    peer.process(images.left, images.right, plane, 800);
    addErrors(mission, pair, resultOf(peer), peer_errors);
    if (sweeps > 0 && k % (report.pairs / sweeps) == 0 && k / (report.pairs / sweeps) < sweeps)
      sweepPair(mission, pair, images, 1.0 / static_cast<double>(sweeps), report.sweep);
    std::fprintf(stderr, "%s: %zu of %zu pairs\n", report.name.c_str(), k + 1, report.pairs);
  }
  report.peer = accuracyOf(peer_errors);
  double squares = 0, count = 0;
  for (const PointError& e : report.sparse) {
    if (std::abs(e.disparity) > 1) continue;
    squares += e.disparity * e.disparity;
    count += 1;
  }
  report.sigma_disparity = std::sqrt(squares / std::max(count, 1.0));
  return report;
}

// Height errors over depth: each point, the root mean square in bins, and the rig's theory.
web::Plot depthPlot(const MissionReport& m) {
  double nearest = INFINITY, farthest = 0;
  for (const PointError& e : m.sparse) {
    nearest = std::min(nearest, e.depth);
    farthest = std::max(farthest, e.depth);
  }
  const double per_square = m.sigma_disparity / (0.5 * (m.rig.left.fx + m.rig.left.fy) * m.rig.baseline());
  const double top = 4e3 * per_square * farthest * farthest;
  web::Plot plot{.title = m.name + ": theory is z² σd/(f b), σd = " + decimals(m.sigma_disparity, 3) + " px",
                 .x = "depth [m]",
                 .y = "height error [mm]"};
  web::Series dots{.label = "corners", .kind = web::Series::Kind::kDots, .size = 1};
  const std::size_t every = std::max<std::size_t>(1, m.sparse.size() / 6000);
  for (std::size_t i = 0; i < m.sparse.size(); i += every)
    if (std::abs(1e3 * m.sparse[i].height) < top)
      dots.at.emplace_back(m.sparse[i].depth, 1e3 * m.sparse[i].height);
  plot.series.push_back(std::move(dots));
  for (const double k : {1.0, 3.0}) {
    web::Series curve{.label = k > 1 ? "3 σ of theory" : "1 σ", .colour = web::kRed, .dashed = k > 1};
    for (const double sign : {-1.0, 1.0}) {
      for (int i = 0; i <= 60; ++i) {
        const double z = nearest + (farthest - nearest) * i / 60;
        curve.at.emplace_back(z, 1e3 * sign * k * per_square * z * z);
      }
      curve.lift();
    }
    plot.series.push_back(std::move(curve));
  }
  return plot;
}

web::Plot sweepPlot(const MissionReport& m) {
  web::Plot plot{
      .title = m.name + ": height", .x = "features wanted", .y = "RMS height error [mm]", .width = 460};
  const auto curve = [&](double SweepRow::*rms, const char* colour, bool dashed, const char* label) {
    web::Series line{.label = label, .colour = colour, .dashed = dashed, .size = 2};
    for (const SweepRow& r : m.sweep) line.at.emplace_back(r.features, 1e3 * (r.*rms));
    plot.series.push_back(std::move(line));
  };
  curve(&SweepRow::height_rms, web::kBlue, false, "Fathom, against its mesh of 5000 features");
  curve(&SweepRow::peer_height_rms, web::kRed, false, "OpenCV, against its own");
  curve(&SweepRow::truth_rms, web::kGreen, true, "Fathom, against the truth");
  return plot;
}

bench::Table accuracyTable(const std::vector<MissionReport>& missions) {
  bench::Table table{"Disparity [px], and heights against their stated sigma",
                     {{"", 0},
                      {"points", 0},
                      {"|error| median", 3},
                      {"90 %", 3},
                      {"99 %", 3},
                      {"bias", 4},
                      {"beyond 1 px [%]", 2},
                      {"beyond 3 σz + 1 cm [%]", 2},
                      {"RMS of error / σz", 2},
                      {"by quarters of σz", 0}},
                     {}};
  const auto add = [&](const std::string& name, const Accuracy& a) {
    std::string quarters;
    for (const double h : a.error_over_sigma_by_sigma)
      quarters += (quarters.empty() ? "" : " ") + decimals(h, 2);
    const bool stated = a.error_over_sigma > 0;
    table.rows.push_back({name, cell(a.points), a.median, a.p90, a.p99, a.bias, 100 * a.beyond_1px,
                          stated ? 100 * a.outliers : NAN, stated ? a.error_over_sigma : NAN, quarters});
  };
  for (const MissionReport& m : missions) {
    add(m.name + ", 800 corners", accuracyOf(m.sparse));
    add(m.name + ", dense, 800 cells", accuracyOf(m.dense));
    add(m.name + ", OpenCV, 800 corners", m.peer);
  }
  return table;
}

bench::Table sweepTable(const MissionReport& m) {
  bench::Table table{m.name + ": over the number of features",
                     {{"features", 0},
                      {"points", 0},
                      {"OpenCV points", 0},
                      {"height RMS [mm]", 2},
                      {"OpenCV height", 2},
                      {"to the truth [mm]", 2},
                      {"OpenCV to the truth", 2}},
                     {}};
  for (const SweepRow& r : m.sweep)
    table.rows.push_back({cell(r.features), r.points, r.peer_points, 1e3 * r.height_rms,
                          1e3 * r.peer_height_rms, 1e3 * r.truth_rms, 1e3 * r.peer_truth_rms});
  return table;
}

struct StereoOptions {
  std::vector<std::filesystem::path> missions;
  std::filesystem::path out;
  std::size_t pairs = 40, sweep_pairs = 5;
};

int runStereo(const StereoOptions& options) {
  cv::setNumThreads(1);
  std::vector<MissionReport> missions;
  for (const auto& folder : options.missions)
    missions.push_back(measure(folder, options.pairs, options.sweep_pairs));
  bench::Page page("Stereo against the truth");
  page.add(accuracyTable(missions));
  for (const MissionReport& m : missions) {
    page.report().plot(depthPlot(m));
    if (m.sweep.front().features == 0) continue;
    page.report().plot(sweepPlot(m));
    page.add(sweepTable(m));
  }
  std::printf("%s", page.text().c_str());
  page.write(options.out, "stereo");
  return kExitSuccess;
}

}  // namespace
}  // namespace fathom::stereo

namespace fathom::bench {

void stereoReport(CommandLine& program) {
  static stereo::StereoOptions o;
  CommandLine& command =
      program.command("stereo", "Stereo against the truth of simulated missions, and against OpenCV", "",
                      [] { return stereo::runStereo(o); });
  command.add_option("missions", o.missions, "simulated mission folders")->required();
  command.add_option("--out", o.out, "folder that gets stereo.html and stereo.json")->required();
  command.shown("--pairs", o.pairs, "of each mission, spread over it", 1, 100000);
  command.shown("--sweep-pairs", o.sweep_pairs, "of these, for height over features; 0: none");
}

}  // namespace fathom::bench
