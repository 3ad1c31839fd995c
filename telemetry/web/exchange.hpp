#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "realtime/base/files/descriptor.hpp"

namespace fathom::web {

namespace status {
inline constexpr int kOk = 200, kPartial = 206, kBadRequest = 400, kUnauthorised = 401, kForbidden = 403,
                     kNotFound = 404, kConflict = 409, kNeedsLength = 411, kTooLarge = 413,
                     kBadEncoding = 415, kBadRange = 416, kHeadTooLarge = 431, kFailed = 500, kBusy = 503;
}  // namespace status

// A request that has arrived whole and passed Access.
struct HttpRequest {
  std::string method;  // "GET", "HEAD", "POST"
  std::string path;    // percent-decoded, with its first slash
  std::string query;   // as it was sent, behind the question mark
  std::string range;   // header Range; empty: none
  std::string body;
  std::string below;  // the path after a route's prefix

  // A parameter of the query, decoded; empty where it is absent.
  [[nodiscard]] std::string parameter(std::string_view name) const;
};

// Decodes %XX to bytes; nullopt when a percent sign is followed by anything else.
[[nodiscard]] std::optional<std::string> percentDecoded(std::string_view text);

// A regular file, open for reading.
class OpenFile {
 public:
  explicit OpenFile(int descriptor) : file_(descriptor) {}
  // Reads `size` bytes from an offset; returns the number read, 0 at the end or when the disk fails.
  [[nodiscard]] std::size_t read(std::uint64_t offset, char* to, std::size_t size) const;

 private:
  Descriptor file_;
};

// An answer: a body in memory, or a part of a file that is read while it is sent.
struct Response {
  int status = status::kOk;
  std::string type = "text/plain";  // MIME
  std::vector<std::pair<std::string, std::string>> headers;
  std::string body;
  std::shared_ptr<const OpenFile> file;
  std::uint64_t file_offset = 0, file_bytes = 0;

  [[nodiscard]] std::uint64_t size() const { return file ? file_bytes : body.size(); }
};

[[nodiscard]] Response answer(std::string body, std::string type);
// An error answer of one line.
[[nodiscard]] Response refusal(int status, std::string_view why);

using Handler = std::function<Response(const HttpRequest&)>;

// Handlers by method and path. GET routes answer HEAD as well.
class Routes {
 public:
  enum class Work {
    kShort,  // milliseconds
    kLong,   // seconds: one at a time, beside the others
  };
  struct Route {
    std::string method, path;
    bool prefix = false;  // everything below the path, which ends with a slash
    bool events = false;  // the server's event stream; no handler
    Work work = Work::kShort;
    Handler handler;
  };

  void get(std::string path, Handler handler, Work work = Work::kShort);
  void getBelow(std::string prefix, Handler handler);
  void post(std::string path, Handler handler);
  // Server-sent events: see PageServer::publish.
  void events(std::string path);

  // The route of exactly this path, else the one with the longest prefix of it; null: none.
  [[nodiscard]] const Route* find(std::string_view method, std::string_view path) const;

 private:
  std::vector<Route> routes_;
};

}  // namespace fathom::web
