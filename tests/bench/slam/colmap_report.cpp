// Poses from images alone, beside COLMAP's: the same folder of 8-bit grey pairs and the same calibration, on
// all cores, one after the other.
#include <sys/wait.h>

#include <cstdio>
#include <fstream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "realtime/base/input_error.hpp"
#include "realtime/base/text.hpp"
#include "recon/geometry/se3.hpp"
#include "recon/topside/dive.hpp"
#include "recon/topside/input/scout_planes.hpp"
#include "tests/bench/common/measures.hpp"
#include "tests/bench/common/page.hpp"
#include "tests/bench/common/true_mission.hpp"
#include "tests/bench/reports.hpp"

namespace fathom::bench {
namespace {

namespace fs = std::filesystem;

struct ColmapOptions {
  fs::path mission, out = "colmap-report";
  std::size_t pairs = 0;
  int overlap = 20;
  bool exhaustive = false;
};

// Cameras of one model, by number of the pair.
using Places = std::map<std::size_t, Eigen::Vector3d>;

struct Result {
  std::string name, how;
  double seconds = 0;
  std::size_t pairs = 0;      // of all models
  std::vector<Places> parts;  // left cameras, each in a frame of its own, largest first
};

std::string nameOf(std::size_t pair, const char* side) {
  return formatted("%05zu_%s.png", pair, side);
}

void writeImages(const TrueMission& mission, std::size_t pairs, const fs::path& folder) {
  fs::create_directories(folder);
  for (std::size_t k = 0; k < pairs; ++k)
    for (const CameraSide side : {CameraSide::kLeft, CameraSide::kRight}) {
      const io::ImageFile file = mission.image(k, side);
      std::vector<std::uint8_t> grey = topside::stretchedGrey(file.view);
      cv::imwrite((folder / nameOf(k, side == CameraSide::kLeft ? "left" : "right")).string(),
                  cv::Mat(file.view.height, file.view.width, CV_8U, grey.data()));
    }
}

Result byFathom(const fs::path& folder, const fs::path& work) {
  Result out{"Fathom", "stereo, images alone", 0, 0, {}};
  topside::TopsideConfig config;
  topside::StageStore store(work, topside::StageStore::Access::kAlone);
  topside::RunProgress progress(topside::expectedShareUpTo(topside::Stage::kLocalise));
  const double start = wallMs();
  topside::Dive dive(topside::openMission(folder, {}), config, store, progress, topside::Permission());
  const topside::SlamResult& slam = *dive.localised();
  out.seconds = 1e-3 * (wallMs() - start);
  const SE3& T_body_cam = dive.input().mission.T_body_cam;
  for (const auto& part : slam.parts) {
    Places& places = out.parts.emplace_back();
    for (const std::uint32_t pair : part.pairs) {
      const std::string& name = dive.survey().list.pairs[pair].left;
      places[std::stoul(fs::path(name).filename().string())] =
          (*slam.poses[pair].T_nav_body * T_body_cam).translation();
    }
    out.pairs += places.size();
  }
  return out;
}

void command(const std::string& line, const fs::path& log) {
  const int status = std::system((line + " >> " + log.string() + " 2>&1").c_str());
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
    throw InputError(log.string(), "", "COLMAP ended with an error; its last lines say why");
}

// With half a pixel more: COLMAP's first pixel has its centre at (0.5, 0.5).
std::string parametersOf(const Camera& c) {
  return formatted("%.10g,%.10g,%.10g,%.10g,%.10g,%.10g,%.10g,%.10g,%.10g,0,0,0", c.fx, c.fy, c.cx + 0.5,
                   c.cy + 0.5, c.k1, c.k2, c.p1, c.p2, c.k3);
}

// Centres of the left cameras of a model in text: two lines an image, of which the first has its pose.
Places readImages(const fs::path& file) {
  Places places;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line.front() == '#') continue;
    std::istringstream words(line);
    int id = 0, camera = 0;
    Eigen::Quaterniond q;
    Eigen::Vector3d t;
    std::string name;
    words >> id >> q.w() >> q.x() >> q.y() >> q.z() >> t.x() >> t.y() >> t.z() >> camera >> name;
    if (words && name.find("left") != std::string::npos) places[std::stoul(name)] = -(q.conjugate() * t);
    std::getline(in, line);  // its points
  }
  return places;
}

Result byColmap(const ColmapOptions& o, const StereoRig& rig, std::size_t pairs, const fs::path& images,
                const fs::path& folder) {
  if (std::system("colmap help > /dev/null 2>&1") != 0)
    throw InputError("colmap", "", "is not installed; apt-get install colmap");
  Result out{"COLMAP", o.exhaustive ? "all pairs of images" : formatted("%d images on", o.overlap), 0, 0, {}};
  fs::create_directories(folder / "sparse");
  const fs::path log = folder / "colmap.log", database = folder / "database.db";
  for (const char* side : {"left", "right"}) {
    std::ofstream list(folder / (std::string(side) + ".txt"));
    for (std::size_t k = 0; k < pairs; ++k) list << nameOf(k, side) << '\n';
  }
  const std::string at = " --database_path " + database.string() + " ",
                    of = "--image_path " + images.string() + " ";
  const double start = wallMs();
  for (const auto& [side, camera] : {std::pair("left", rig.left), std::pair("right", rig.right)})
    command("colmap feature_extractor" + at + of + "--image_list_path " + (folder / side).string() +
                ".txt --ImageReader.single_camera 1 --ImageReader.camera_model FULL_OPENCV "
                "--ImageReader.camera_params " +
                parametersOf(camera) + " --SiftExtraction.use_gpu 0",
            log);
  const double extracted = wallMs();
  command(o.exhaustive ? "colmap exhaustive_matcher" + at + "--SiftMatching.use_gpu 0"
                       : "colmap sequential_matcher" + at + "--SiftMatching.use_gpu 0 " +
                             formatted("--SequentialMatching.overlap %d", o.overlap),
          log);
  const double matched = wallMs();
  command("colmap mapper" + at + of + "--output_path " + (folder / "sparse").string() +
              " --Mapper.ba_refine_focal_length 0 --Mapper.ba_refine_principal_point 0 "
              "--Mapper.ba_refine_extra_params 0",
          log);
  out.seconds = 1e-3 * (wallMs() - start);
  std::printf("COLMAP: features %.0f s, matches %.0f s, mapper %.0f s\n", 1e-3 * (extracted - start),
              1e-3 * (matched - extracted), out.seconds - 1e-3 * (matched - start));
  for (const auto& model : fs::directory_iterator(folder / "sparse")) {
    command("colmap model_converter --output_type TXT --input_path " + model.path().string() +
                " --output_path " + model.path().string(),
            log);
    out.parts.push_back(readImages(model.path() / "images.txt"));
    out.pairs += out.parts.back().size();
  }
  return out;
}

// Distances from the true places once moved onto them; `scaled` as well, where images have no scale.
std::vector<double> errorsOf(const Places& places, const TrueMission& truth, bool scaled) {
  const auto count = static_cast<Eigen::Index>(places.size());
  if (count < 3) return {};
  Eigen::Matrix3Xd from(3, count), to(3, count);
  Eigen::Index column = 0;
  for (const auto& [pair, place] : places) {
    from.col(column) = place;
    to.col(column++) = truth.pairs()[pair].T_nav_cam.translation();
  }
  const Eigen::Matrix4d T = rigidAlignment(from, to, scaled);
  const Eigen::Matrix3Xd left =
      ((T.topLeftCorner<3, 3>() * from).colwise() + Eigen::Vector3d(T.topRightCorner<3, 1>())) - to;
  std::vector<double> errors;
  for (Eigen::Index k = 0; k < count; ++k) errors.push_back(left.col(k).norm());
  return errors;
}

int runColmap(const ColmapOptions& o) {
  const TrueMission mission(o.mission);
  const std::size_t all = mission.pairs().size(), pairs = o.pairs == 0 ? all : std::min(o.pairs, all);
  if (fs::exists(o.out)) throw InputError(o.out.string(), "", "is there already; give another --out");
  const fs::path images = o.out / "dive";
  writeImages(mission, pairs, images);
  writeStereoCalib(images / "stereo.calib", mission.rig());

  std::vector<Result> results;
  results.push_back(byFathom(images, o.out / "work"));
  results.push_back(byColmap(o, mission.rig(), pairs, images, o.out / "colmap"));
  Page page("Poses from images alone, beside COLMAP");
  Table table{formatted("%zu pairs of %s", pairs, o.mission.filename().c_str()),
              {{"by"},
               {"images joined"},
               {"pairs"},
               {"parts"},
               {"of the largest"},
               {"seconds", 1},
               {"rms [mm]", 1},
               {"at most [mm]", 1},
               {"rms, scaled too [mm]", 1}},
              {}};
  for (Result& r : results) {
    std::sort(r.parts.begin(), r.parts.end(),
              [](const Places& a, const Places& b) { return a.size() > b.size(); });
    const Places largest = r.parts.empty() ? Places() : r.parts[0];
    const bool metric = r.name == "Fathom";  // without the baseline a model has no scale
    const std::vector<double> rigid = metric ? errorsOf(largest, mission, false) : std::vector<double>(),
                              scaled = errorsOf(largest, mission, true);
    const double most = metric ? quantile(rigid, 1) : quantile(scaled, 1);
    table.rows.push_back({r.name, r.how, cell(r.pairs), cell(r.parts.size()), cell(largest.size()),
                          cell(r.seconds), cell(metric ? 1e3 * rmsOf(rigid) : std::nan("")), cell(1e3 * most),
                          cell(1e3 * rmsOf(scaled))});
  }
  page.add(table);
  std::printf("%s\nCOLMAP's time over Fathom's: %.1f\n", page.text().c_str(),
              results[1].seconds / results[0].seconds);
  page.write(o.out, "colmap");
  return 0;
}

}  // namespace

void colmapReport(CommandLine& program) {
  static ColmapOptions o;
  CommandLine& command = program.command(
      "colmap", "Poses from images alone: time and error beside COLMAP's, which must be installed", "",
      [] { return runColmap(o); });
  command.add_option("mission", o.mission, "simulated mission with images")->required();
  command.add_option("--out", o.out, "new folder for both and the report");
  command.shown("--pairs", o.pairs, "the first so many (all)", 3, 1e6);
  command.shown("--overlap", o.overlap, "images after each that COLMAP compares with it", 1, 1000);
  command.add_flag("--exhaustive", o.exhaustive, "COLMAP compares all images with all");
}

}  // namespace fathom::bench
