#include "telemetry/web/http_server.hpp"

#include <malloc.h>
#include <sys/resource.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <vector>

namespace fathom::web {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

namespace {

constexpr int kMmapThreshold_bytes = 1 << 20;
// Before accepting again, when no connection is free or the process has no descriptor left.
constexpr std::chrono::milliseconds kPause{20};

// A quarter of the process's descriptors at most: the rest is for files.
std::size_t maxConnections() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return kMaxConnections;
  return std::clamp<std::size_t>(limit.rlim_cur / 4, 1, kMaxConnections);
}

}  // namespace

HttpServer::HttpServer(const Config& config, Routes routes)
    : access_(config.token),
      routes_(std::move(routes)),
      headers_(config.headers),
      max_body_bytes_(config.max_body_bytes) {
  // Large answers are mapped, so that their memory goes back to the system instead of fragmenting the heap
  // (of the whole process).
  ::mallopt(M_MMAP_THRESHOLD, kMmapThreshold_bytes);
  listen(config);
  accept();
  tick();
  thread_ = std::thread([this] {
    while (!io_.stopped()) {
      try {
        io_.run();
      } catch (const std::exception&) {
        // A connection's handler threw, usually for lack of memory; its deadline closes the connection.
      }
    }
  });
}

HttpServer::~HttpServer() {
  io_.stop();
  thread_.join();
}

void HttpServer::listen(const Config& config) {
  tcp::resolver resolver(io_);
  const auto found = resolver.resolve(config.address, std::to_string(config.port),
                                      tcp::resolver::passive | tcp::resolver::numeric_service);
  const tcp::endpoint endpoint = *found.begin();
  acceptor_.open(endpoint.protocol());
  acceptor_.set_option(tcp::acceptor::reuse_address(true));
  acceptor_.bind(endpoint);
  acceptor_.listen(tcp::acceptor::max_listen_connections);
  acceptor_port_ = acceptor_.local_endpoint().port();
}

void HttpServer::accept() {
  acceptor_.async_accept([this](error_code error, tcp::socket socket) {
    if (!error) return admit(std::move(socket));
    if (error == asio::error::connection_aborted || evict(Evictable::kAny, nullptr)) return accept();
    pause_.expires_after(kPause);
    pause_.async_wait([this](error_code) { accept(); });
  });
}

void HttpServer::admit(tcp::socket socket) {
  if (connections_.size() >= maxConnections() && !evict(Evictable::kAny, nullptr)) {
    pause_.expires_after(kPause);
    return pause_.async_wait(
        [this, waiting = std::move(socket)](error_code) mutable { admit(std::move(waiting)); });
  }
  try {
    const auto connection = std::make_shared<Connection>(*this, std::move(socket));
    connections_.insert(connection);
    connection->start();
  } catch (const std::exception&) {
    // Out of memory for this connection.
  }
  accept();
}

bool HttpServer::evict(Evictable which, const Connection* keep) {
  using Phase = Connection::Phase;
  const auto now = Connection::Clock::now();
  std::shared_ptr<Connection> victim;  // of the earliest phase, and in it the oldest
  for (const auto& one : connections_) {
    if (one.get() == keep || one->phase() > Phase::kSending) continue;
    if (which == Evictable::kSending && one->phase() != Phase::kSending) continue;
    if (which == Evictable::kAny && !one->sendsInParts() && now - one->since() < kGrace) continue;
    if (victim == nullptr ||
        std::pair(one->phase(), one->since()) < std::pair(victim->phase(), victim->since()))
      victim = one;
  }
  if (victim == nullptr) return false;
  victim->close();
  return true;
}

void HttpServer::boundHeldBytes(const Connection& newest) {
  // The largest answer is exempt, so that one large download can always complete.
  const auto held = [&] {
    std::size_t sum = 0, largest = 0;
    for (const auto& one : connections_) {
      if (one.get() == &newest) continue;
      sum += one->heldBytes();
      largest = std::max(largest, one->heldBytes());
    }
    return sum - largest;
  };
  while (held() > kMaxHeldBytes && evict(Evictable::kSending, &newest)) {
  }
}

void HttpServer::tick() {
  ticks_.expires_after(kTick);
  ticks_.async_wait([this](error_code) { tick(); });
  const std::vector<std::shared_ptr<Connection>> all(connections_.begin(), connections_.end());
  const auto now = Connection::Clock::now();
  for (const auto& one : all) one->tick(now);
}

bool HttpServer::hasRoomForStream() const {
  const auto open = std::count_if(connections_.begin(), connections_.end(), [](const auto& one) {
    return one->phase() == Connection::Phase::kStreaming;
  });
  return static_cast<std::size_t>(open) < std::max<std::size_t>(maxConnections() / kConnectionsPerStream, 1);
}

void HttpServer::publish(std::string text) {
  asio::post(io_, [this, text = std::make_shared<const std::string>(std::move(text))]() mutable {
    event_ = std::move(text);
    ++event_number_;
  });
}

}  // namespace fathom::web
