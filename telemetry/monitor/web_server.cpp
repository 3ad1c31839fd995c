#include "telemetry/monitor/web_server.hpp"

#include <httplib.h>

#include <atomic>
#include <charconv>
#include <chrono>
#include <thread>

#include "realtime/kernel/input_error.hpp"

namespace fathom::monitor {
namespace {

using namespace std::chrono_literals;

constexpr std::size_t kThreads = 24;    // each event stream holds one
constexpr int kMaxEventStreams = 16;    // a page refused a stream asks for the state instead
constexpr auto kEventInterval = 250ms;  // a person does not see faster
constexpr auto kHeartbeat = 5s;         // tells a closed connection from a quiet dive
constexpr std::size_t kMaxRequestBytes = 1024;

void noStore(httplib::Response& response) {
  response.set_header("Cache-Control", "no-store");
}

std::uint64_t sinceOf(const httplib::Request& request) {
  const std::string text = request.get_param_value("since");
  std::uint64_t since = 0;
  std::from_chars(text.data(), text.data() + text.size(), since);
  return since;
}

}  // namespace

struct WebServer::Impl {
  explicit Impl(SharedModel& s) : shared(s) {}
  void routes();
  void events(httplib::Response& response);

  SharedModel& shared;
  httplib::Server server;
  std::thread thread;
  std::atomic<int> streams{0};
  int port = 0;
};

void WebServer::Impl::routes() {
  server.Get("/api/state", [this](const httplib::Request&, httplib::Response& response) {
    const std::lock_guard lock(shared.mutex);
    noStore(response);
    response.set_content(stateJson(shared.model, shared.feed), "application/json");
  });
  server.Get("/api/track", [this](const httplib::Request&, httplib::Response& response) {
    const std::lock_guard lock(shared.mutex);
    noStore(response);
    response.set_content(trackJson(shared.model), "application/json");
  });
  server.Get("/api/tiles", [this](const httplib::Request& request, httplib::Response& response) {
    const std::lock_guard lock(shared.mutex);
    noStore(response);
    response.set_content(tilesBinary(shared.model, sinceOf(request)), "application/octet-stream");
  });
  server.Get("/api/events",
             [this](const httplib::Request&, httplib::Response& response) { events(response); });
}

void WebServer::Impl::events(httplib::Response& response) {
  if (streams.fetch_add(1) >= kMaxEventStreams) {
    --streams;
    response.status = 503;
    return;
  }
  noStore(response);
  auto seen = std::make_shared<std::uint64_t>(UINT64_MAX);
  response.set_chunked_content_provider(
      "text/event-stream",
      [this, seen](std::size_t, httplib::DataSink& sink) {
        std::string line = ": quiet\n\n";
        {
          std::unique_lock lock(shared.mutex);
          shared.grew.wait_for(lock, kHeartbeat,
                               [&] { return shared.closing || shared.model.version() != *seen; });
          if (shared.closing) {
            lock.unlock();
            sink.done();
            return true;
          }
          if (shared.model.version() != *seen) {
            *seen = shared.model.version();
            line = "data: {\"version\":" + std::to_string(*seen) +
                   ",\"map_version\":" + std::to_string(shared.model.map().version()) + "}\n\n";
          }
        }
        if (!sink.write(line.data(), line.size())) return false;
        std::this_thread::sleep_for(kEventInterval);
        return true;
      },
      [this](bool) { --streams; });
}

WebServer::WebServer(SharedModel& shared, const std::string& address, int port,
                     const std::filesystem::path& page)
    : impl_(std::make_unique<Impl>(shared)) {
  if (!std::filesystem::is_regular_file(page / "index.html"))
    throw InputError(page.string(), "",
                     "holds no index.html: build the target fathom_monitor_page, or give --page");
  impl_->server.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
  impl_->server.set_payload_max_length(kMaxRequestBytes);
  impl_->server.set_keep_alive_timeout(2);
  impl_->routes();
  impl_->server.set_mount_point("/", page.string());
  impl_->port = port == 0                                   ? impl_->server.bind_to_any_port(address)
                : impl_->server.bind_to_port(address, port) ? port
                                                            : -1;
  if (impl_->port <= 0)
    throw InputError("--http " + std::to_string(port), address,
                     "cannot listen there: the port is taken or the address not ours");
  impl_->thread = std::thread([this] { impl_->server.listen_after_bind(); });
}

WebServer::~WebServer() {
  {
    const std::lock_guard lock(impl_->shared.mutex);
    impl_->shared.closing = true;
  }
  impl_->shared.grew.notify_all();
  // stop() only acts on a server that runs already.
  while (!impl_->server.is_running()) std::this_thread::sleep_for(1ms);
  impl_->server.stop();
  impl_->thread.join();
}

int WebServer::port() const {
  return impl_->port;
}

}  // namespace fathom::monitor
