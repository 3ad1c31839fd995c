#include <cmath>
#include <span>

#include "recon/import/calibration/calibration.hpp"
#include "tests/fuzz/scratch_file.hpp"
#include "tests/support/text_files.hpp"
#include "tests/topside/calibration_files.hpp"

using namespace fathom;
namespace fs = std::filesystem;

namespace {

// Good files of every form, by name; those that belong together have their own folder.
std::vector<std::vector<std::pair<std::string, std::string>>> goodFiles(const fs::path& folder) {
  const StereoRig rig = test::divingRig();
  writeStereoCalib(folder / "stereo.calib", rig);
  for (const char* name : {"stereo.yml", "stereo.xml", "stereo.json"}) test::writeOpenCv(folder / name, rig);
  test::writeOpenCvPair(folder / "intrinsics.yml", folder / "extrinsics.yml", rig);
  std::vector<std::vector<std::pair<std::string, std::string>>> files{
      {{"extrinsics.yml", ""}, {"intrinsics.yml", ""}}};
  for (const char* name : {"stereo.calib", "stereo.yml", "stereo.xml", "stereo.json"})
    files.push_back({{name, ""}});
  for (auto& group : files)
    for (auto& [name, text] : group) text = test::readText(folder / name);
  files.push_back({{"stereo.calib", files[1][0].second},
                   {"stereo.calib.ports", "0 0.01 1 0.02 0.01 1.49 1.339\n0 0 1 0.02 0.01 1.49 1.339\n"}});
  files.push_back({{"camchain.yaml", test::kalibrText(rig)}});
  files.push_back({{"cameras.txt", test::colmapCameras(rig)}, {"rigs.txt", test::colmapRigs(rig)}});
  files.push_back(
      {{"rig_config.json", test::colmapRigConfig(rig).dump()}, {"cameras.txt", test::colmapCameras(rig)}});
  files.push_back({{"old.json", test::matlabStruct(rig).dump()}});
  files.push_back({{"new.json", test::matlabObject(rig).dump()}});
  return files;
}

void read(const fs::path& file, std::optional<double> unit) {
  fuzz::readsOrRefuses([&] {
    StereoRig rig = topside::readCalibration(file, unit).rig;
    topside::takeSizes(rig, file, {1360, 1024}, {1360, 1024});
    for (const Camera& c : {rig.left, rig.right})
      for (const double v : {c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3})
        if (!std::isfinite(v) || !(c.fx > 0) || !(c.fy > 0) || c.width < 1 || c.height < 1) __builtin_trap();
    if (!(rig.baseline() > 0) || !rig.T_right_left.matrix3().allFinite()) __builtin_trap();
  });
}

}  // namespace

// Any bytes, and good files of every form with any bytes in them, as a calibration; the first byte says
// which.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const fuzz::ScratchFile scratch("any");
  static const auto good = goodFiles(scratch.folder());
  if (size == 0) return 0;
  const std::uint8_t which = data[0];
  std::span<const std::uint8_t> rest(data + 1, size - 1);
  const std::optional<double> unit = which >= 128 ? std::optional(0.001) : std::nullopt;
  const std::size_t form = which % 128 % (good.size() + 1);
  if (form == good.size()) {
    scratch.write(rest.data(), rest.size());
    read(scratch.path(), unit);
    return 0;
  }
  const fs::path folder = scratch.folder() / std::to_string(form);
  auto group = good[form];
  // Four bytes name a place in one of the files and what stands there.
  for (; rest.size() >= 4; rest = rest.subspan(4)) {
    std::string& text = group[rest[0] % group.size()].second;
    text[(rest[1] | rest[2] << 8) % text.size()] = static_cast<char>(rest[3]);
  }
  for (const auto& [name, text] : group) test::writeText(folder / name, text);
  for (const auto& [name, text] : group) read(folder / name, unit);
  fuzz::readsOrRefuses([&] { static_cast<void>(topside::findCalibration(folder)); });
  return 0;
}
