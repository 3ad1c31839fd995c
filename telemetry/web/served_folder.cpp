#include "telemetry/web/served_folder.hpp"

#include <httplib.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <memory>
#include <string>
#include <utility>

#include "telemetry/web/page_server.hpp"

namespace fathom::web {
namespace {

using httplib::Request;
using httplib::Response;

constexpr std::size_t kPiece = 1 << 16;  // of a file read and sent at a time [bytes]

// MIME type by the name's ending; "application/octet-stream" for those unknown.
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

// Browsers ask for whole blocks, the last of which ends behind the file's end. A range is to be cut there
// (RFC 9110, 14.1.2), which this httplib leaves to its user though it hands the request over as constant.
// Gives whether every range begins inside the file.
bool cutRanges(const Request& request, std::size_t size) {
  const auto end = static_cast<ssize_t>(size);
  auto& ranges = const_cast<Request&>(request).ranges;
  for (auto& [first, last] : ranges) {
    if (first >= end) {
      ranges.clear();  // they would be taken of the refusal's text
      return false;
    }
    if (first < 0) {  // the last so many bytes
      first = std::max<ssize_t>(end - last, 0);
      last = end - 1;
    }
    last = last < 0 ? end - 1 : std::min(last, end - 1);
  }
  return true;
}

}  // namespace

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

void sendFile(const std::optional<std::filesystem::path>& path, const Request& request, Response& response) {
  if (!path) return refuse(response, kNotFound, "There is no such file.");
  auto file = std::make_shared<std::ifstream>(*path, std::ios::binary);
  std::error_code error;
  const auto size = std::filesystem::file_size(*path, error);
  if (!*file || error) return refuse(response, kNotFound, "The file cannot be read.");
  const std::string type(contentType(*path));
  if (size == 0) return response.set_content("", type);
  if (!cutRanges(request, size)) return refuse(response, kBadRange, "The file ends before that.");
  response.set_content_provider(static_cast<std::size_t>(size), type,
                                [file](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
                                  std::array<char, kPiece> piece;
                                  file->clear();
                                  file->seekg(static_cast<std::streamoff>(offset));
                                  file->read(piece.data(),
                                             static_cast<std::streamsize>(std::min(length, piece.size())));
                                  const auto got = static_cast<std::size_t>(file->gcount());
                                  return got > 0 && sink.write(piece.data(), got);
                                });
}

}  // namespace fathom::web
