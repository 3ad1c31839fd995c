#include "recon/compare/surface_file.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <string_view>

#include "realtime/kernel/input_error.hpp"

namespace fathom::compare {
namespace {

std::string lowerExtension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

}  // namespace

std::unique_ptr<SurfaceFile> openSurface(const std::filesystem::path& path, const std::string& crs,
                                         const FrameBeside& beside) {
  std::error_code error;
  if (!std::filesystem::exists(path, error))
    throw InputError(path.string(), "",
                     "is absent; name a folder of fathom-topside, a GeoTIFF, PLY or XYZ file");
  if (std::filesystem::is_directory(path, error)) {
    for (const char* name : {"layers/elevation.tif", "mesh.ply"})
      if (std::filesystem::exists(path / name, error)) return openSurface(path / name, crs, beside);
    throw InputError(path.string(), "",
                     "holds neither layers/elevation.tif nor mesh.ply; run fathom-topside first");
  }
  const std::string extension = lowerExtension(path);
  if (extension == ".ply") return openMesh(path, crs, beside);
  constexpr std::array<std::string_view, 6> kText = {".xyz", ".txt", ".csv", ".pts", ".dat", ".xyb"};
  if (std::find(kText.begin(), kText.end(), extension) != kText.end()) return openPoints(path, crs);
  return openRaster(path, crs);
}

}  // namespace fathom::compare
