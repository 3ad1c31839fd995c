#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "telemetry/web/access.hpp"

namespace httplib {
class Server;
struct Response;
}  // namespace httplib

namespace fathom::web {

inline constexpr int kBadRequest = 400, kUnauthorised = 401, kForbidden = 403, kNotFound = 404,
                     kConflict = 409, kBadRange = 416, kFailed = 500, kBusy = 503;

// Answers with one line that says why not.
void refuse(httplib::Response& response, int status, std::string_view why);

// Where the build puts a page's files: share/fathom/NAME beside the program's own folder.
[[nodiscard]] std::filesystem::path builtPage(const std::string& name);
// `given`, or where it is empty builtPage(name). Throws InputError where it holds no index.html.
[[nodiscard]] std::filesystem::path pageFolder(const std::filesystem::path& given, const std::string& name);

struct PageServerConfig {
  std::string address = "127.0.0.1";
  int port = 0;                    // 0: any that is free
  std::string option;              // that chose the port, for the message when it cannot be had: "--http"
  std::size_t threads = 8;         // a browser asks for six files at a time
  std::size_t max_body_bytes = 0;  // of anything posted
  std::filesystem::path page;      // served at /
  std::string token;               // see Access
};

// A page's HTTP server: every request passes Access first, and every answer forbids its keeping, its framing
// and guesses of its type. Runs from construction to destruction.
class PageServer {
 public:
  // `routes` adds what the page asks for beside its files. Throws InputError where it cannot listen.
  PageServer(const PageServerConfig& config, const std::function<void(httplib::Server&)>& routes);
  ~PageServer();
  PageServer(const PageServer&) = delete;
  PageServer& operator=(const PageServer&) = delete;
  [[nodiscard]] int port() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Serves the files of a folder below a path that ends with a slash.
void serveFolder(httplib::Server& server, const std::string& path, const std::filesystem::path& folder);

}  // namespace fathom::web
