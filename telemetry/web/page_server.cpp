#include "telemetry/web/page_server.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/system/system_error.hpp>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <string>

#include "realtime/base/input_error.hpp"
#include "realtime/base/install_prefix.hpp"
#include "telemetry/web/http_server.hpp"

namespace fathom::web {
namespace {

struct Kind {
  std::string_view ending, type;
  enum { kPassive, kActive, kPicture } what = kPassive;  // kActive: a browser may run it
};

// By the name's ending; "application/octet-stream" for those unknown.
Kind kindOf(const std::filesystem::path& file) {
  static constexpr std::array kKinds{Kind{".html", "text/html; charset=utf-8", Kind::kActive},
                                     Kind{".js", "text/javascript", Kind::kActive},
                                     Kind{".css", "text/css", Kind::kActive},
                                     Kind{".svg", "image/svg+xml", Kind::kActive},
                                     Kind{".json", "application/json"},
                                     Kind{".wasm", "application/wasm"},
                                     Kind{".glb", "model/gltf-binary"},
                                     Kind{".ktx2", "image/ktx2"},
                                     Kind{".csv", "text/csv"},
                                     Kind{".geojson", "application/geo+json"},
                                     Kind{".tif", "image/tiff", Kind::kPicture},
                                     Kind{".tiff", "image/tiff", Kind::kPicture},
                                     Kind{".png", "image/png", Kind::kPicture},
                                     Kind{".jpg", "image/jpeg", Kind::kPicture},
                                     Kind{".jpeg", "image/jpeg", Kind::kPicture},
                                     Kind{".bmp", "image/bmp", Kind::kPicture},
                                     Kind{".webp", "image/webp", Kind::kPicture},
                                     Kind{".jp2", "image/jp2", Kind::kPicture},
                                     Kind{".pgm", "image/x-portable-graymap", Kind::kPicture},
                                     Kind{".ppm", "image/x-portable-pixmap", Kind::kPicture}};
  std::string ending = file.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto* const found =
      std::find_if(kKinds.begin(), kKinds.end(), [&](const Kind& kind) { return kind.ending == ending; });
  return found == kKinds.end() ? Kind{"", "application/octet-stream"} : *found;
}

// Takes a number off the front of a text.
std::optional<std::uint64_t> takeNumber(std::string_view& text) {
  std::uint64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc()) return std::nullopt;
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return number;
}

struct Range {
  std::uint64_t first, last;
};

// One range of bytes (RFC 9110, 14.1.2). Browsers ask for whole blocks, the last of which may end after the
// file's end: it is cut there. Nullopt for anything else, such as several ranges: the answer to those is the
// whole file.
std::optional<Range> rangeOf(std::string_view header, std::uint64_t size) {
  constexpr std::string_view kUnit = "bytes=";
  if (!header.starts_with(kUnit)) return std::nullopt;
  header.remove_prefix(kUnit.size());
  const auto first = takeNumber(header);
  if (!header.starts_with('-')) return std::nullopt;
  header.remove_prefix(1);
  const auto last = takeNumber(header);
  if (!header.empty()) return std::nullopt;
  if (first && (!last || *last >= *first)) return Range{*first, std::min(last.value_or(size - 1), size - 1)};
  if (!first && last) return Range{*last == 0 ? size : size - std::min(*last, size), size - 1};
  return std::nullopt;
}

constexpr const char* kHeaders =
    "Cache-Control: no-store\r\n"
    "X-Content-Type-Options: nosniff\r\n"
    "X-Frame-Options: DENY\r\n"
    "Referrer-Policy: no-referrer\r\n"
    "Cross-Origin-Resource-Policy: same-origin\r\n"
    "Cross-Origin-Opener-Policy: same-origin\r\n";

std::string policyOf(const PageServerConfig& config) {
  return "default-src 'none'; script-src 'self'" + config.more_scripts +
         "; connect-src 'self' data: blob:; img-src 'self' data: blob:; style-src 'self'; "
         "base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
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

Response fileResponse(const std::optional<std::filesystem::path>& path, const HttpRequest& request) {
  if (!path) return refusal(status::kNotFound, "There is no such file.");
  // Opened without waiting, in case it is a pipe.
  const int descriptor = ::open(path->c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (descriptor < 0)
    return errno == EMFILE || errno == ENFILE ? refusal(status::kBusy, "Too many files are open: ask again.")
                                              : refusal(status::kNotFound, "The file cannot be read.");
  Response response;
  response.file = std::make_shared<const OpenFile>(descriptor);
  struct stat about {};
  if (::fstat(descriptor, &about) != 0 || !S_ISREG(about.st_mode))
    return refusal(status::kNotFound, "There is no such file.");
  response.type = kindOf(*path).type;
  response.headers.emplace_back("Accept-Ranges", "bytes");
  const auto size = static_cast<std::uint64_t>(about.st_size);
  response.file_bytes = size;
  const auto range = rangeOf(request.range, size);
  if (!range) return response;
  if (range->first >= size) return refusal(status::kBadRange, "The file ends before that.");
  response.status = status::kPartial;
  response.file_offset = range->first;
  response.file_bytes = range->last - range->first + 1;
  response.headers.emplace_back("Content-Range", "bytes " + std::to_string(range->first) + '-' +
                                                     std::to_string(range->last) + '/' +
                                                     std::to_string(size));
  return response;
}

Response dataResponse(const std::optional<std::filesystem::path>& file, const HttpRequest& request) {
  Response response = fileResponse(file, request);
  response.headers.emplace_back("Content-Security-Policy", "default-src 'none'; sandbox");
  if (file && kindOf(*file).what == Kind::kActive && response.file) {
    response.type = "application/octet-stream";
    response.headers.emplace_back("Content-Disposition", "attachment");
  }
  return response;
}

bool isPicture(const std::filesystem::path& file) {
  std::error_code error;
  const std::filesystem::path real = std::filesystem::canonical(file, error);
  return !error && kindOf(file).what == Kind::kPicture && kindOf(real).what == Kind::kPicture;
}

std::filesystem::path builtPage(const std::string& name) {
  return installPrefix() / "share/fathom" / name;
}

std::filesystem::path pageFolder(const std::filesystem::path& given, const std::string& name) {
  std::filesystem::path folder = given.empty() ? builtPage(name) : given;
  if (!std::filesystem::is_regular_file(folder / "index.html"))
    throw InputError(folder.string(), "",
                     "holds no index.html: build the target fathom_" + name + "_page, or give --page");
  return folder;
}

PageServer::PageServer(const PageServerConfig& config, Routes routes) {
  routes.getBelow("/", [folder = config.page, policy = policyOf(config)](const HttpRequest& request) {
    const std::string& name = request.below.empty() ? "index.html" : request.below;
    Response page = fileResponse(fileInside(folder, name), request);
    page.headers.emplace_back("Content-Security-Policy", policy);
    return page;
  });
  try {
    server_ = std::make_unique<HttpServer>(
        HttpServer::Config{config.address, config.port, config.max_body_bytes, config.token, kHeaders},
        std::move(routes));
  } catch (const boost::system::system_error&) {
    throw InputError(config.option + ' ' + std::to_string(config.port), config.address,
                     "cannot listen there: the port is taken or the address not ours");
  }
}

PageServer::~PageServer() = default;

int PageServer::port() const {
  return server_->port();
}

void PageServer::publish(std::string text) {
  server_->publish(std::move(text));
}

}  // namespace fathom::web
