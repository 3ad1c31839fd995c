#include <cmath>
#include <cstdio>
#include <memory>

#include "realtime/base/text.hpp"
#include "recon/geometry/colour.hpp"
#include "recon/topside/calibration/chart_images.hpp"
#include "recon/topside/commands/commands.hpp"

namespace fathom::topside {
namespace {

struct CalibrateColourOptions {
  std::vector<std::filesystem::path> images;
  std::vector<double> corners;
  std::string format = "auto";
  std::filesystem::path out;
};

int calibrateColour(const CalibrateColourOptions& o) {
  std::optional<ChartCorners> corners;
  if (!o.corners.empty()) {
    if (o.images.size() != 1) throw InputError("--corners", "", "are of one image; give one");
    corners.emplace();
    for (std::size_t k = 0; k < corners->size(); ++k)
      (*corners)[k] = {o.corners[2 * k], o.corners[2 * k + 1]};
  }
  std::vector<calibration::ChartView> views;
  for (const std::filesystem::path& image : o.images) {
    for (calibration::ChartView& view : readCharts(image, samplesNamed(o.format), corners)) {
      for (int k = 0; k < calibration::kPatches; ++k)
        if (!view.patches[static_cast<std::size_t>(k)])
          std::printf("%s: %s is clipped or too small, left out\n", view.name.c_str(),
                      calibration::patchName(k));
      views.push_back(std::move(view));
    }
  }
  const calibration::ColourCalibration done = calibrateColours(views, o.images[0].string());
  std::printf("CIEDE2000          without the matrix   with the matrix\n");
  for (int k = 0; k < calibration::kPatches; ++k) {
    const auto i = static_cast<std::size_t>(k);
    if (!std::isnan(done.after[i]))
      std::printf("  %-14s %20.1f %17.1f\n", calibration::patchName(k), done.before[i], done.after[i]);
  }
  std::printf(
      "median %.1f, with the matrix %.1f; worst then %.1f; of each patch by the others %.1f and %.1f\n",
      done.median_before, done.median_after, done.worst_after, done.held_before, done.held_after);
  writeColours(o.out, done.matrix);
  std::printf("%s written\n", o.out.c_str());
  return kExitSuccess;
}

}  // namespace

void addCalibrateColourCommand(CommandLine& app) {
  const auto options = std::make_shared<CalibrateColourOptions>();
  CommandLine& command = app.command(
      "calibrate-colour", "a camera's colours from photographs of a chart of 24 patches, in water",
      "Example: fathom-topside calibrate-colour chart.tif --out stereo.calib.colour",
      [options] { return calibrateColour(*options); });
  command.add_option("images", options->images, "of the chart, by the left camera, at working range")
      ->required()
      ->check(CLI::ExistingFile);
  command
      .add_option("--corners", options->corners,
                  "where no chart is found: u,v of the outer corners of dark skin, bluish green, black and "
                  "white, separated by commas [px]")
      ->delimiter(',')
      ->expected(8);
  command.shown("--format", options->format, "of the samples; auto: as the file says")
      ->check(CLI::IsMember(sampleNames()));
  command
      .add_option("--out", options->out,
                  "file to write; beside stereo.calib as stereo.calib.colour it is used by itself")
      ->required();
}

}  // namespace fathom::topside
