#include "recon/viewer/served_folder.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <utility>

namespace fathom::viewer {

std::optional<std::filesystem::path> fileInside(const std::filesystem::path& root, std::string_view request) {
  if (request.empty() || request.front() == '/' || request.find('\\') != std::string_view::npos ||
      request.find('\0') != std::string_view::npos)
    return std::nullopt;
  const std::filesystem::path relative{std::string(request)};
  const bool leaves = std::any_of(relative.begin(), relative.end(),
                                  [](const std::filesystem::path& part) { return part == ".."; });
  if (leaves || relative.is_absolute()) return std::nullopt;
  std::error_code error;
  std::filesystem::path file = root / relative;
  if (!std::filesystem::is_regular_file(file, error) || error) return std::nullopt;
  return file;
}

std::string_view contentType(const std::filesystem::path& file) {
  using Pair = std::pair<std::string_view, std::string_view>;
  static constexpr std::array kTypes{Pair{".html", "text/html; charset=utf-8"},
                                     Pair{".js", "text/javascript"},
                                     Pair{".css", "text/css"},
                                     Pair{".json", "application/json"},
                                     Pair{".wasm", "application/wasm"},
                                     Pair{".glb", "model/gltf-binary"},
                                     Pair{".ktx2", "image/ktx2"},
                                     Pair{".tif", "image/tiff"},
                                     Pair{".tiff", "image/tiff"},
                                     Pair{".png", "image/png"},
                                     Pair{".jpg", "image/jpeg"},
                                     Pair{".csv", "text/csv"},
                                     Pair{".geojson", "application/geo+json"},
                                     Pair{".svg", "image/svg+xml"}};
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto* const found =
      std::find_if(kTypes.begin(), kTypes.end(), [&](const Pair& pair) { return pair.first == ending; });
  return found == kTypes.end() ? "application/octet-stream" : found->second;
}

bool namesThisMachine(std::string_view host) {
  const bool bracketed = !host.empty() && host.front() == '[';
  const std::size_t port = bracketed ? host.find(':', host.find(']')) : host.find(':');
  const std::string_view name = host.substr(0, port);
  return name == "127.0.0.1" || name == "localhost" || name == "[::1]";
}

}  // namespace fathom::viewer
