#include "telemetry/web/page_server.hpp"

#include <httplib.h>

#include <chrono>
#include <thread>

#include "realtime/kernel/input_error.hpp"
#include "realtime/kernel/install_prefix.hpp"
#include "telemetry/web/served_folder.hpp"

namespace fathom::web {
namespace {

using httplib::Request;
using httplib::Response;
using Handled = httplib::Server::HandlerResponse;

// Gives whether the request was answered with a refusal.
Handled guard(const Access& access, const Request& request, Response& response) {
  response.set_header("Cache-Control", "no-store");
  response.set_header("X-Content-Type-Options", "nosniff");
  response.set_header("X-Frame-Options", "DENY");
  response.set_header("Referrer-Policy", "no-referrer");
  response.set_header("Cross-Origin-Resource-Policy", "same-origin");
  const std::string host = request.get_header_value("Host"), cookie = request.get_header_value("Cookie"),
                    token = request.get_header_value(kTokenHeader), query = request.get_param_value("token");
  const std::string site = request.get_header_value("Sec-Fetch-Site");
  switch (access.judge({request.method, host, cookie, token, query, site, request.has_header(kPageHeader)})) {
    case AccessVerdict::kUnauthorised:
      refuse(response, kUnauthorised,
             "This page wants its token: open the address that the program printed.");
      return Handled::Handled;
    case AccessVerdict::kForbidden:
      refuse(response, kForbidden, "Only this server's own page, opened on this machine, may do that.");
      return Handled::Handled;
    case AccessVerdict::kEnterAndSetCookie:
      response.set_header("Set-Cookie", access.setCookie());
      break;
    case AccessVerdict::kEnter:
      break;
  }
  return Handled::Unhandled;
}

}  // namespace

void refuse(Response& response, int status, std::string_view why) {
  response.status = status;
  response.set_content(std::string(why) + "\n", "text/plain");
}

std::filesystem::path builtPage(const std::string& name) {
  return installPrefix() / "share/fathom" / name;
}

std::filesystem::path pageFolder(const std::filesystem::path& given, const std::string& name) {
  const std::filesystem::path folder = given.empty() ? builtPage(name) : given;
  if (!std::filesystem::is_regular_file(folder / "index.html"))
    throw InputError(folder.string(), "",
                     "holds no index.html: build the target fathom_" + name + "_page, or give --page");
  return folder;
}

void serveFolder(httplib::Server& server, const std::string& path, const std::filesystem::path& folder) {
  server.Get(path + "(.*)", [folder](const Request& request, Response& response) {
    sendFile(fileInside(folder, request.matches[1].str()), request, response);
  });
}

struct PageServer::Impl {
  explicit Impl(const std::string& token) : access(token) {}
  Access access;
  httplib::Server server;
  std::thread thread;
  int port = 0;
};

PageServer::PageServer(const PageServerConfig& config, const std::function<void(httplib::Server&)>& routes)
    : impl_(std::make_unique<Impl>(config.token)) {
  httplib::Server& server = impl_->server;
  server.new_task_queue = [threads = config.threads] { return new httplib::ThreadPool(threads); };
  server.set_payload_max_length(config.max_body_bytes);
  // One request a connection: what is left of a request that was refused must not be read as the next one.
  server.set_keep_alive_max_count(1);
  server.set_pre_routing_handler(
      [this](const Request& request, Response& response) { return guard(impl_->access, request, response); });
  // The library's own options would let two programs share a port, and each get a part of the requests.
  server.set_socket_options([](socket_t socket) {
    const int yes = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  routes(server);
  server.Get("/", [page = config.page](const Request& request, Response& response) {
    sendFile(fileInside(page, "index.html"), request, response);
  });
  serveFolder(server, "/", config.page);
  impl_->port = config.port == 0                                   ? server.bind_to_any_port(config.address)
                : server.bind_to_port(config.address, config.port) ? config.port
                                                                   : -1;
  if (impl_->port <= 0)
    throw InputError(config.option + ' ' + std::to_string(config.port), config.address,
                     "cannot listen there: the port is taken or the address not ours");
  impl_->thread = std::thread([this] { impl_->server.listen_after_bind(); });
}

PageServer::~PageServer() {
  // stop() only acts on a server that runs already.
  while (!impl_->server.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  impl_->server.stop();
  impl_->thread.join();
}

int PageServer::port() const {
  return impl_->port;
}

}  // namespace fathom::web
