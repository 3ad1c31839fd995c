// Stereo against the truth of simulated missions, and against OpenCV in the same run: depth and disparity
// errors, whether the reported uncertainty is honest, and time and height error over the number of features
// (figure 6 of Johnson-Roberson et al. 2010). Writes report.html and report.json.
#include <time.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "realtime/kernel/command_line.hpp"
#include "realtime/kernel/input_error.hpp"
#include "recon/geometry/atomic_file.hpp"
#include "recon/stereo/delaunay.hpp"
#include "recon/stereo/dense_stereo.hpp"
#include "recon/topside/report/html_text.hpp"
#include "recon/topside/report/svg_plot.hpp"
#include "tests/bench/opencv_stereo.hpp"
#include "tests/bench/stereo_accuracy.hpp"

namespace fathom::stereo {
namespace {

using Json = nlohmann::ordered_json;
using topside::fixedDigits;

constexpr int kFeatures[] = {200, 400, 800, 1200, 2000, 3000, 4000, 5000};
constexpr int kReference = 5000;  // features of the mesh that heights are compared with
constexpr int kStep = 8;          // of the depth images [px]
constexpr int kRepeats = 3;       // the fastest counts

double threadMs() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

template <typename Work>
double fastest(Work work) {
  double best = INFINITY;
  for (int k = 0; k < kRepeats; ++k) {
    const double begin = threadMs();
    work();
    best = std::min(best, threadMs() - begin);
  }
  return best;
}

ImageView viewOf(const cv::Mat& image) {
  return {image.data, image.cols, image.rows, image.step, PixelFormat::kMono, 8};
}

std::vector<float> depthOf(const StereoResult& r, int width, int height) {
  std::vector<Eigen::Vector2d> pixels;
  std::vector<double> depth;
  for (const StereoPoint& p : r.points) {
    pixels.push_back(p.left.cast<double>());
    depth.push_back(static_cast<double>(p.point.z()));
  }
  return depthImage(pixels, depth, r.triangles, width, height, kStep);
}

std::vector<float> depthOf(const OpenCvStereo& peer, int width, int height) {
  std::vector<Eigen::Vector2d> pixels;
  std::vector<Delaunay::Point> lattice;
  std::vector<double> depth;
  for (std::size_t i = 0; i < peer.points.size(); ++i) {
    pixels.emplace_back(peer.left[i].x, peer.left[i].y);
    lattice.push_back({static_cast<std::int32_t>(std::lround(peer.left[i].x)),
                       static_cast<std::int32_t>(std::lround(peer.left[i].y))});
    depth.push_back(peer.points[i].z());
  }
  Delaunay delaunay;
  return depthImage(pixels, depth, delaunay.triangulate(lattice), width, height, kStep);
}

struct SweepRow {
  int features = 0;
  double ms = 0, peer_ms = 0, points = 0, peer_points = 0;  // means over the pairs
  double height_rms = 0, peer_height_rms = 0;  // against each one's own mesh of 5000 features [m]
  double truth_rms = 0, peer_truth_rms = 0;    // against the true surface [m]
  std::vector<std::pair<std::string, double>> stage_ms;
};

struct MissionReport {
  std::string name;
  std::size_t pairs = 0;
  std::vector<PointError> sparse, dense;
  Accuracy peer;
  std::vector<SweepRow> sweep;
  double sigma_disparity = 0;  // root mean square of the disparity errors below 1 px [px]
};

std::vector<float> trueDepth(const TrueMission& mission, const TruePair& pair) {
  std::vector<float> image;
  for (int y = 0; y < pair.left.rows; y += kStep)
    for (int x = 0; x < pair.left.cols; x += kStep) {
      const auto p = mission.pointAt(pair, {x, y});
      image.push_back(p ? static_cast<float>(p->z()) : 0.0F);
    }
  return image;
}

void sweepPair(const TrueMission& mission, const TruePair& pair, double share, std::vector<SweepRow>& rows) {
  const int width = pair.left.cols, height = pair.left.rows;
  const std::vector<float> truth = trueDepth(mission, pair);
  SparseStereoConfig config;
  config.max_features = kReference;
  SparseStereo reference(mission.rig(), config);
  const std::vector<float> best =
      depthOf(reference.process(viewOf(pair.left), viewOf(pair.right), pair.plane), width, height);
  OpenCvStereo peer(mission.rig());
  peer.process(pair.left, pair.right, pair.plane, kReference);
  const std::vector<float> peer_best = depthOf(peer, width, height);
  for (std::size_t k = 0; k < std::size(kFeatures); ++k) {
    SweepRow& row = rows[k];
    row.features = kFeatures[k];
    config.max_features = row.features;
    SparseStereo stereo(mission.rig(), config);
    const StereoResult* result = &stereo.process(viewOf(pair.left), viewOf(pair.right), pair.plane);
    Mesh mesh;
    row.ms += share * fastest([&] {
                result = &stereo.process(viewOf(pair.left), viewOf(pair.right), pair.plane);
                mesh = toMesh(*result, {});
              });
    row.points += share * static_cast<double>(result->points.size());
    const std::vector<float> depth = depthOf(*result, width, height);
    row.height_rms += share * rmsDifference(depth, best);
    row.truth_rms += share * rmsDifference(depth, truth);
    double last = 0;
    std::size_t stage = 0;
    stereo.setStageObserver([&](const char* name) {
      if (row.stage_ms.size() <= stage) row.stage_ms.emplace_back(name, 0.0);
      row.stage_ms[stage++].second += share * (threadMs() - last);
      last = threadMs();
    });
    last = threadMs();
    stereo.process(viewOf(pair.left), viewOf(pair.right), pair.plane);

    row.peer_ms += share * fastest([&] { peer.process(pair.left, pair.right, pair.plane, row.features); });
    row.peer_points += share * static_cast<double>(peer.points.size());
    const std::vector<float> peer_depth = depthOf(peer, width, height);
    row.peer_height_rms += share * rmsDifference(peer_depth, peer_best);
    row.peer_truth_rms += share * rmsDifference(peer_depth, truth);
  }
}

StereoResult resultOf(const OpenCvStereo& peer) {
  StereoResult r;
  for (std::size_t i = 0; i < peer.points.size(); ++i) {
    r.points.emplace_back();
    r.points.back().left = {peer.left[i].x, peer.left[i].y};
    r.points.back().right = {peer.right[i].x, peer.right[i].y};
    r.points.back().point = peer.points[i].cast<float>();
  }
  return r;
}

MissionReport measure(const std::filesystem::path& folder, std::size_t wanted, std::size_t sweep_pairs) {
  const TrueMission mission(folder);
  MissionReport report;
  report.name = folder.filename().string();
  report.pairs = std::min(wanted, mission.pairs());
  report.sweep.resize(std::size(kFeatures));
  SparseStereo sparse(mission.rig(), {});
  DenseStereo dense(mission.rig(), {}, {});
  OpenCvStereo peer(mission.rig());
  std::vector<PointError> peer_errors;
  const std::size_t sweeps = std::min(sweep_pairs, report.pairs);
  for (std::size_t k = 0; k < report.pairs; ++k) {
    const TruePair pair = mission.pair(k * mission.pairs() / report.pairs);
    const ImageView left = viewOf(pair.left), right = viewOf(pair.right);
    addErrors(mission, pair, sparse.process(left, right, pair.plane), report.sparse);
    addErrors(mission, pair, dense.process(left, right, pair.plane), report.dense);
    peer.process(pair.left, pair.right, pair.plane, 800);
    addErrors(mission, pair, resultOf(peer), peer_errors);
    if (sweeps > 0 && k % (report.pairs / sweeps) == 0 && k / (report.pairs / sweeps) < sweeps)
      sweepPair(mission, pair, 1.0 / static_cast<double>(sweeps), report.sweep);
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

Json toJson(const Accuracy& a) {
  return {{"points", a.points},
          {"disparity_median_px", a.median},
          {"disparity_p90_px", a.p90},
          {"disparity_p99_px", a.p99},
          {"disparity_bias_px", a.bias},
          {"beyond_1px", a.beyond_1px},
          {"outliers", a.outliers},
          {"sigma_honesty", a.honesty},
          {"sigma_honesty_by_quarter", a.honesty_by_sigma}};
}

Json toJson(const MissionReport& m) {
  Json json{{"mission", m.name},
            {"pairs", m.pairs},
            {"sparse", toJson(accuracyOf(m.sparse))},
            {"dense", toJson(accuracyOf(m.dense))},
            {"opencv", toJson(m.peer)}};
  for (const SweepRow& r : m.sweep) {
    Json stages = Json::object();
    for (const auto& [name, ms] : r.stage_ms) stages[name] = ms;
    json["sweep"].push_back({{"features", r.features},
                             {"ms", r.ms},
                             {"opencv_ms", r.peer_ms},
                             {"points", r.points},
                             {"opencv_points", r.peer_points},
                             {"height_rms_m", r.height_rms},
                             {"opencv_height_rms_m", r.peer_height_rms},
                             {"truth_rms_m", r.truth_rms},
                             {"opencv_truth_rms_m", r.peer_truth_rms},
                             {"stage_ms", stages}});
  }
  return json;
}

std::string accuracyRow(const std::string& name, const Accuracy& a) {
  std::string bins;
  for (const double h : a.honesty_by_sigma) bins += (bins.empty() ? "" : " ") + fixedDigits(h, 2);
  return "<tr><td>" + name + "</td><td>" + std::to_string(a.points) + "</td><td>" + fixedDigits(a.median, 3) +
         "</td><td>" + fixedDigits(a.p90, 3) + "</td><td>" + fixedDigits(a.p99, 3) + "</td><td>" +
         fixedDigits(a.bias, 4) + "</td><td>" + fixedDigits(100 * a.beyond_1px, 2) + "</td><td>" +
         (a.honesty > 0 ? fixedDigits(100 * a.outliers, 2) + "</td><td>" + fixedDigits(a.honesty, 2)
                        : "-</td><td>-") +
         "</td><td>" + bins + "</td></tr>\n";
}

// Height errors over depth: each point, the root mean square in bins, and the rig's theory.
std::string depthPlot(const MissionReport& m, const StereoRig& rig) {
  double nearest = INFINITY, farthest = 0;
  for (const PointError& e : m.sparse) {
    nearest = std::min(nearest, e.depth);
    farthest = std::max(farthest, e.depth);
  }
  const double per_square = m.sigma_disparity / (0.5 * (rig.left.fx + rig.left.fy) * rig.baseline());
  const double top = 4e3 * per_square * farthest * farthest;
  topside::PlotAxes axes;
  axes.width = 520;
  axes.left = std::floor(nearest * 5) / 5;
  axes.right = std::ceil(farthest * 5) / 5;
  axes.bottom = -top;
  axes.top = top;
  axes.x_label = "depth [m]";
  axes.y_label = "height error [mm]";
  axes.title =
      m.name + ": 1 and 3 sigma of theory, z² σd/(f b), σd = " + fixedDigits(m.sigma_disparity, 3) + " px";
  topside::SvgPlot plot(axes);
  std::vector<Eigen::Vector2d> dots;
  const std::size_t every = std::max<std::size_t>(1, m.sparse.size() / 6000);
  for (std::size_t i = 0; i < m.sparse.size(); i += every)
    if (std::abs(1e3 * m.sparse[i].height) < top)
      dots.emplace_back(m.sparse[i].depth, 1e3 * m.sparse[i].height);
  plot.dots(dots, 1.0, "#3b6ea5", 0.35);
  for (const double k : {-3.0, -1.0, 1.0, 3.0}) {
    std::vector<Eigen::Vector2d> curve;
    for (int i = 0; i <= 60; ++i) {
      const double z = axes.left + (axes.right - axes.left) * i / 60;
      curve.emplace_back(z, 1e3 * k * per_square * z * z);
    }
    plot.line(curve, "#c0392b", 1.5, std::abs(k) > 1);
  }
  return plot.svg();
}

std::string sweepPlot(const MissionReport& m, bool time) {
  topside::PlotAxes axes;
  axes.width = 460;
  axes.right = kReference;
  axes.x_label = "features wanted";
  axes.y_label = time ? "CPU time of a pair, one thread [ms]" : "RMS height error [mm]";
  axes.title = m.name + (time ? ": time" : ": height");
  double top = 0;
  for (const SweepRow& r : m.sweep)
    top = std::max(top, time ? std::max(r.ms, r.peer_ms) : 1e3 * std::max({r.height_rms, r.peer_height_rms}));
  axes.top = std::max(1.1 * top, 1.0);
  topside::SvgPlot plot(axes);
  const auto curve = [&](auto value, const char* colour, bool dashed, const char* label, double at) {
    std::vector<Eigen::Vector2d> line;
    for (const SweepRow& r : m.sweep) line.emplace_back(r.features, std::min(value(r), axes.top));
    plot.line(line, colour, 2, dashed);
    plot.dots(line, 3, colour);
    plot.text({0.45 * axes.right, at * axes.top}, label, colour, 12);
  };
  if (time) {
    curve([](const SweepRow& r) { return r.ms; }, "#1f77b4", false, "Fathom", 0.94);
    curve([](const SweepRow& r) { return r.peer_ms; }, "#d62728", false, "OpenCV", 0.87);
  } else {
    curve([](const SweepRow& r) { return 1e3 * r.height_rms; }, "#1f77b4", false,
          "Fathom, against its mesh of 5000 features", 0.94);
    curve([](const SweepRow& r) { return 1e3 * r.peer_height_rms; }, "#d62728", false,
          "OpenCV, against its own", 0.87);
    curve([](const SweepRow& r) { return 1e3 * r.truth_rms; }, "#2ca02c", true, "Fathom, against the truth",
          0.80);
  }
  return plot.svg();
}

std::string page(const std::vector<MissionReport>& missions, const std::vector<StereoRig>& rigs) {
  std::string html = topside::htmlHead("Stereo against the truth");
  html +=
      "<table><tr><th></th><th>points</th><th>|disparity error| median [px]</th><th>90 %</th><th>99 "
      "%</th><th>bias</th>"
      "<th>beyond 1 px [%]</th><th>outliers: beyond 3 σz + 1 cm [%]</th><th>RMS of error / σz</th><th>by "
      "quarters of σz</th></tr>\n";
  for (const MissionReport& m : missions) {
    html += accuracyRow(m.name + ", 800 corners", accuracyOf(m.sparse));
    html += accuracyRow(m.name + ", dense, 800 cells", accuracyOf(m.dense));
    html += accuracyRow(m.name + ", OpenCV, 800 corners", m.peer);
  }
  html += "</table>\n";
  for (std::size_t i = 0; i < missions.size(); ++i) {
    const MissionReport& m = missions[i];
    html += "<div>" + depthPlot(m, rigs[i]) + "</div>\n";
    if (m.sweep.front().features == 0) continue;
    html +=
        "<div>" + sweepPlot(m, true) + sweepPlot(m, false) +
        "</div>\n<table><tr><th>features</th><th>Fathom [ms]</th>"
        "<th>OpenCV [ms]</th><th>ratio</th><th>points</th><th>OpenCV points</th><th>stages [ms]</th></tr>\n";
    for (const SweepRow& r : m.sweep) {
      std::string stages;
      for (const auto& [name, ms] : r.stage_ms) stages += name + " " + fixedDigits(ms, 1) + " ";
      html += "<tr><td>" + std::to_string(r.features) + "</td><td>" + fixedDigits(r.ms, 1) + "</td><td>" +
              fixedDigits(r.peer_ms, 1) + "</td><td>" + fixedDigits(r.ms / r.peer_ms, 2) + "</td><td>" +
              fixedDigits(r.points, 0) + "</td><td>" + fixedDigits(r.peer_points, 0) + "</td><td>" + stages +
              "</td></tr>\n";
    }
    html += "</table>\n";
  }
  return html + "</body></html>\n";
}

void write(const std::filesystem::path& path, const std::string& text) {
  AtomicFile file(path);
  file.stream() << text;
  file.commit();
}

}  // namespace
}  // namespace fathom::stereo

int main(int argc, char** argv) {
  CLI::App app("Stereo against the truth of simulated missions, and against OpenCV");
  std::vector<std::filesystem::path> folders;
  std::filesystem::path out;
  std::size_t pairs = 40, sweep_pairs = 5;
  app.add_option("missions", folders, "simulated mission folders")->required();
  app.add_option("--out", out, "folder that gets report.html and report.json")->required();
  app.add_option("--pairs", pairs, "of each mission, spread over it")->check(CLI::Range(1, 100000));
  app.add_option("--sweep-pairs", sweep_pairs, "of these, for time over features; 0: none");
  if (const auto code = fathom::parseCommandLine("report_stereo", app, argc, argv)) return *code;
  return fathom::runTool("report_stereo", [&]() -> int {
    using namespace fathom::stereo;
    cv::setNumThreads(1);
    std::filesystem::create_directories(out);
    std::vector<MissionReport> missions;
    std::vector<fathom::StereoRig> rigs;
    Json json = Json::array();
    for (const auto& folder : folders) {
      missions.push_back(measure(folder, pairs, sweep_pairs));
      rigs.push_back(fathom::readStereoCalib(folder / "stereo.calib"));
      json.push_back(toJson(missions.back()));
    }
    write(out / "report.json", json.dump(2) + "\n");
    write(out / "report.html", page(missions, rigs));
    return fathom::kExitSuccess;
  });
}
