#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "recon/geometry/stereo_rig.hpp"
#include "recon/import/images/image_pairs.hpp"
#include "recon/import/images/image_samples.hpp"
#include "recon/topside/work/digest.hpp"

namespace fathom::topside {

struct ColourCameraOptions {
  std::vector<std::string> images = {};            // a shell pattern for each camera
  std::vector<std::filesystem::path> calibs = {};  // of the left camera and this one as a pair, for each
  std::string format = "auto";                     // of sampleNames()
};

// A camera beside the pair that takes its images at the same moments; they colour the model.
struct ColourCamera {
  std::vector<std::filesystem::path> files;
  Camera camera;
  SE3 T_cam_left;
  Samples samples = Samples::kAuto;
  PixelFormat format = PixelFormat::kMono;
  int bits = 8;
};

// `left`: the pair's left camera, which each calibration must begin with. Adds to `assumed` what was found.
// Throws InputError for options that do not go together, calibrations and images that cannot be used.
[[nodiscard]] std::vector<ColourCamera> openColourCameras(const ColourCameraOptions& options,
                                                          std::optional<double> calib_unit,
                                                          const Camera& left,
                                                          std::vector<std::string>& assumed);

// Gives each pair the cameras' images of its moment: those with the left image's name, number or time.
// `images`: the folder that the pairs' names start from. Throws InputError for a camera without any.
void takeColourImages(const std::vector<ColourCamera>& cameras, const std::filesystem::path& images,
                      double tolerance, PairList& list);

}  // namespace fathom::topside
