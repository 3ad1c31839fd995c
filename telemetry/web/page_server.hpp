#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "telemetry/web/exchange.hpp"

namespace fathom::web {

// The file inside `root` that a request's path names (already percent-decoded, relative, with slashes), or
// none: for an absent file, a folder, an empty path, and any path that would leave the folder ("..", an
// absolute path, a backslash, a NUL). Links inside the folder are followed: they belong to the folder's
// owner.
[[nodiscard]] std::optional<std::filesystem::path> fileInside(const std::filesystem::path& root,
                                                              std::string_view request);

// That file, or the one range of it that was asked for; without one, 404, and 416 for a range that begins
// after its end. The type follows from the name's ending.
[[nodiscard]] Response fileResponse(const std::optional<std::filesystem::path>& file,
                                    const HttpRequest& request);

// Files of unknown origin, such as a dive's: none of them can run in the browser. What a browser would run
// (HTML, SVG, scripts, styles) is sent as a download.
[[nodiscard]] Response dataResponse(const std::optional<std::filesystem::path>& file,
                                    const HttpRequest& request);

// Whether a file is a picture by its name's ending and, where it is a link, by that of what it leads to.
[[nodiscard]] bool isPicture(const std::filesystem::path& file);

// Where the build puts a page's files: share/fathom/NAME beside the program's own folder.
[[nodiscard]] std::filesystem::path builtPage(const std::string& name);
// `given`, or where it is empty builtPage(name). Throws InputError where it holds no index.html.
[[nodiscard]] std::filesystem::path pageFolder(const std::filesystem::path& given, const std::string& name);

struct PageServerConfig {
  std::string address = "127.0.0.1";
  int port = 0;                    // 0: any that is free
  std::string option;              // of the port, for error messages: "--http"
  std::size_t max_body_bytes = 0;  // of anything posted
  std::filesystem::path page;      // served at /
  std::string more_scripts;  // that the page needs beside its own: sources for its Content-Security-Policy
  std::string token;         // see Access
};

class HttpServer;

// A page's HTTP server: checks the Access of every request; every answer forbids caching, framing and type
// sniffing. The page may run only its own scripts and connect only to this server; nothing else that is
// served can run. Bounded for any clients (see HttpServer). Runs from construction to destruction.
class PageServer {
 public:
  // `routes`: what the page asks for beside its files. Throws InputError where it cannot listen.
  PageServer(const PageServerConfig& config, Routes routes);
  ~PageServer();
  PageServer(const PageServer&) = delete;
  PageServer& operator=(const PageServer&) = delete;
  [[nodiscard]] int port() const;
  // Sends a text of one line to all event streams, at most 4 a second: the newest replaces those before. From
  // any thread.
  void publish(std::string text);

 private:
  std::unique_ptr<HttpServer> server_;
};

}  // namespace fathom::web
