#include "telemetry/web/page_server.hpp"

#include <boost/system/system_error.hpp>

#include "realtime/base/input_error.hpp"
#include "realtime/base/install_prefix.hpp"
#include "telemetry/web/http_server.hpp"
#include "telemetry/web/served_folder.hpp"

namespace fathom::web {
namespace {

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
