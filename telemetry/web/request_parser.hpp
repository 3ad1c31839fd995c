#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

#include "telemetry/web/access.hpp"
#include "telemetry/web/exchange.hpp"

namespace fathom::web {

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
