#include "recon/topside/input/colour_cameras.hpp"

#include <cmath>
#include <map>

#include "realtime/base/input_error.hpp"
#include "recon/import/calibration/calibration.hpp"
#include "recon/import/images/image_samples.hpp"
#include "recon/import/images/stereo_files.hpp"

namespace fathom::topside {
namespace {

namespace fs = std::filesystem;

// Two calibrations of one camera agree to some pixels.
bool alike(const Camera& a, const Camera& b) {
  constexpr double kShare = 0.05;  // of the focal length
  return a.width == b.width && a.height == b.height && std::abs(a.fx - b.fx) < kShare * a.fx &&
         std::abs(a.cx - b.cx) < kShare * a.fx && std::abs(a.cy - b.cy) < kShare * a.fx;
}

}  // namespace

std::vector<ColourCamera> openColourCameras(const ColourCameraOptions& options,
                                            std::optional<double> calib_unit, const Camera& left,
                                            std::vector<std::string>& assumed) {
  if (options.images.size() != options.calibs.size())
    throw InputError("--colour", "",
                     "is given for " + std::to_string(options.images.size()) +
                         " cameras, --colour-calib for " + std::to_string(options.calibs.size()) +
                         "; each camera needs both");
  std::vector<ColourCamera> cameras;
  for (std::size_t k = 0; k < options.images.size(); ++k) {
    ColourCamera out;
    out.files = filesMatching(options.images[k], "--colour");
    out.samples = samplesNamed(options.format);
    std::vector<std::string> names;
    for (const fs::path& file : out.files) names.push_back(file.string());
    const Probed found = probe("", names, out.samples, "--colour-format");
    out.format = found.format;
    out.bits = found.bits;
    Calibration calibration = readCalibration(options.calibs[k], calib_unit);
    takeSizes(calibration.rig, options.calibs[k], {left.width, left.height}, found.size);
    if (!alike(calibration.rig.left, left))
      throw InputError(options.calibs[k].string(), "",
                       "has another left camera than the pair's calibration; it must be of the pair's left "
                       "camera and the colour camera");
    out.camera = calibration.rig.right;
    out.T_cam_left = calibration.rig.T_right_left;
    if (out.format == PixelFormat::kMono)
      throw InputError("--colour", options.images[k],
                       "matches grey images, which have no colour to give; a mosaic needs --colour-format");
    assumed.push_back("colour camera: " + std::to_string(out.files.size()) + " images of " +
                      std::to_string(out.bits) + " bits");
    cameras.push_back(std::move(out));
  }
  return cameras;
}

void takeColourImages(const std::vector<ColourCamera>& cameras, const fs::path& images, double tolerance,
                      PairList& list) {
  const fs::path root = asNamed(images / "").parent_path();
  std::vector<fs::path> left;
  std::map<fs::path, ImagePair*> pair_of;
  for (ImagePair& pair : list.pairs) {
    pair.colour.assign(cameras.size(), "");
    left.push_back(asNamed(root / pair.left));
    pair_of[left.back()] = &pair;
  }
  for (std::size_t k = 0; k < cameras.size(); ++k) {
    const auto found = partnersByName(left, cameras[k].files, tolerance);
    for (const StereoFilePair& both : found)
      pair_of.at(both.left)->colour[k] = asNamed(both.right).lexically_proximate(root).generic_string();
    if (found.empty())
      throw InputError("--colour", cameras[k].files.front().string(),
                       "and " + std::to_string(cameras[k].files.size() - 1) +
                           " more have neither name nor number nor time of a left image, as " +
                           list.pairs.front().left);
  }
}

}  // namespace fathom::topside
