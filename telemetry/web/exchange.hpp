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
#include "telemetry/web/access.hpp"

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

// One HTTP/1 request, from bytes in pieces of any size. It holds kMaxHeadBytes of request line and headers
// and `max_body_bytes` of body at most. A body comes by its Content-Length and as it is: chunks are refused,
// because Beast 1.74 ends the program on some, and nothing is ever decompressed. Bytes after the request are
// ignored.
class RequestParser {
 public:
  static constexpr std::size_t kMaxHeadBytes = 8192;

  enum class Step {
    kMore,     // more bytes are needed
    kHead,     // head() is complete; take("") continues with the body
    kWhole,    // request() is there
    kRefused,  // see status() and why()
  };

  explicit RequestParser(std::size_t max_body_bytes);
  ~RequestParser();
  RequestParser(const RequestParser&) = delete;
  RequestParser& operator=(const RequestParser&) = delete;

  [[nodiscard]] Step take(std::string_view bytes);

  // From kHead on; it points into the parser.
  [[nodiscard]] AccessRequest head() const;
  [[nodiscard]] const HttpRequest& request() const { return request_; }
  [[nodiscard]] int status() const { return status_; }
  [[nodiscard]] const std::string& why() const { return why_; }

 private:
  struct Impl;
  [[nodiscard]] Step refuse(int status, const char* why);
  [[nodiscard]] Step readHead();   // of a head that has just come whole
  [[nodiscard]] Step checkBody();  // before any of it is read

  std::unique_ptr<Impl> impl_;
  std::size_t max_body_bytes_;
  int status_ = 0;
  std::string why_;
  HttpRequest request_;
  std::string token_;  // of the query
  bool body_checked_ = false;
};

}  // namespace fathom::web
