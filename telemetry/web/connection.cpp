#include "telemetry/web/connection.hpp"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>

#include "telemetry/web/http_server.hpp"

namespace fathom::web {

namespace asio = boost::asio;
using namespace std::chrono_literals;
using boost::system::error_code;

namespace {

constexpr std::size_t kPiece = 1 << 15;        // of an answer that is sent at a time [bytes]
constexpr std::size_t kMostDrained = 1 << 20;  // [bytes]
constexpr auto kDrainTime = 2s;
constexpr auto kEventTime = 10s;  // for a client to take an event
constexpr auto kHeartbeat = 5s;   // shows whether a quiet stream's connection is closed
// What the system holds for a client that does not read [bytes].
constexpr int kSendBuffer = 1 << 17, kStreamBuffer = 1 << 14;

}  // namespace

Connection::Connection(HttpServer& server, asio::ip::tcp::socket socket)
    : server_(server), socket_(std::move(socket)), parser_(server.max_body_bytes_) {}

void Connection::start() {
  error_code ignored;
  socket_.set_option(asio::ip::tcp::no_delay(true), ignored);
  socket_.set_option(asio::socket_base::send_buffer_size(kSendBuffer), ignored);
  enter(Phase::kReading, kRequestTime);
  read();
}

void Connection::enter(Phase phase, Clock::duration patience) {
  phase_ = phase;
  since_ = Clock::now();
  deadline_ = since_ + patience;
}

void Connection::close() {
  if (phase_ == Phase::kClosed) return;
  error_code ignored;
  // Unsent data is dropped at once; an answer that is all sent may still be in transit.
  if (phase_ != Phase::kDraining) socket_.set_option(asio::socket_base::linger(true, 0), ignored);
  phase_ = Phase::kClosed;
  socket_.close(ignored);
  server_.forget(shared_from_this());
}

void Connection::read() {
  socket_.async_read_some(asio::buffer(in_), [self = shared_from_this()](error_code error, std::size_t size) {
    if (self->phase_ == Phase::kClosed) return;
    // A client that has ended its side while it waits for its answer still gets it.
    if (error || self->phase_ == Phase::kStreaming) return self->close();
    if (self->phase_ == Phase::kReading) return self->take({self->in_.data(), size});
    self->drained_ += size;
    if (self->drained_ > kMostDrained) return self->close();
    self->read();
  });
}

void Connection::take(std::string_view bytes) {
  RequestParser::Step step = parser_.take(bytes);
  if (step == RequestParser::Step::kHead) {
    if (!admit()) return;
    step = parser_.take({});
  }
  switch (step) {
    case RequestParser::Step::kMore:
      sends_in_parts_ = true;
      return read();
    case RequestParser::Step::kRefused:
      return send(refusal(parser_.status(), parser_.why()));
    case RequestParser::Step::kWhole:
    case RequestParser::Step::kHead:
      return dispatch();
  }
}

bool Connection::admit() {
  const AccessRequest head = parser_.head();
  body_wanted_ = head.method != "HEAD";
  switch (server_.access_.judge(head)) {
    case AccessVerdict::kUnauthorised:
      send(refusal(status::kUnauthorised,
                   "This page wants its token: open the address that the program printed."));
      return false;
    case AccessVerdict::kForbidden:
      send(refusal(status::kForbidden, "Only this server's own page, opened on this machine, may do that."));
      return false;
    case AccessVerdict::kEnterAndSetCookie:
      sets_cookie_ = true;
      return true;
    case AccessVerdict::kEnter:
      return true;
  }
  return false;
}

void Connection::dispatch() {
  HttpRequest request = parser_.request();
  const Routes::Route* route = server_.routes_.find(request.method, request.path);
  if (route == nullptr) return send(refusal(status::kNotFound, "There is nothing here."));
  if (route->events && body_wanted_) return stream();
  request.below = request.path.substr(route->path.size());
  enter(Phase::kHandling, kHandlerTime);
  WorkerPool& pool = route->work == Routes::Work::kLong ? server_.long_work_ : server_.short_work_;
  const bool taken = pool.post([self = shared_from_this(), route, request = std::move(request)] {
    Response response;
    try {
      response = route->handler(request);
    } catch (const std::exception& error) {
      response = refusal(status::kFailed, error.what());
    }
    asio::post(self->server_.io_,
               [self, response = std::move(response)]() mutable { self->send(std::move(response)); });
  });
  if (!taken) send(refusal(status::kBusy, "Too much waits to be answered: ask again."));
}

std::string Connection::headOf(const Response& response, bool has_length) const {
  std::string head = "HTTP/1.1 " + std::to_string(response.status) + " \r\nConnection: close\r\n";
  head += "Content-Type: " + response.type + "\r\n";
  if (has_length) head += "Content-Length: " + std::to_string(response.size()) + "\r\n";
  head += server_.headers_;
  for (const auto& [name, value] : response.headers) head += name + ": " + value + "\r\n";
  if (sets_cookie_) head += "Set-Cookie: " + server_.access_.setCookie() + "\r\n";
  return head + "\r\n";
}

void Connection::send(Response response) {
  if (phase_ == Phase::kClosed) return;
  enter(Phase::kSending, kPieceTime);
  response_ = std::move(response);
  piece_ = headOf(response_, true);
  if (!body_wanted_) {
    sent_ = response_.size();
  } else if (response_.body.size() <= kPiece && !response_.file) {
    piece_ += response_.body;
    sent_ = response_.size();
  }
  server_.boundHeldBytes(*this);
  write(piece_.data(), piece_.size());
}

void Connection::write(const char* bytes, std::size_t size) {
  asio::async_write(socket_, asio::buffer(bytes, size),
                    [self = shared_from_this()](error_code error, std::size_t) {
                      if (self->phase_ == Phase::kClosed) return;
                      if (error) return self->close();
                      if (self->phase_ == Phase::kSending) return self->sendNext();
                      self->is_writing_ = false;
                      self->enter(Phase::kStreaming, Clock::duration::max() / 4);
                    });
}

void Connection::sendNext() {
  if (sent_ == response_.size()) return drain();
  enter(Phase::kSending, kPieceTime);
  const auto size = static_cast<std::size_t>(std::min<std::uint64_t>(kPiece, response_.size() - sent_));
  if (!response_.file) {
    sent_ += size;
    return write(response_.body.data() + sent_ - size, size);
  }
  const bool taken = server_.file_reads_.post([self = shared_from_this(), size] {
    self->piece_.resize(size);
    const std::size_t got =
        self->response_.file->read(self->response_.file_offset + self->sent_, self->piece_.data(), size);
    asio::post(self->server_.io_, [self, got] {
      if (self->phase_ == Phase::kClosed) return;
      if (got == 0) return self->close();  // the file became shorter
      self->sent_ += got;
      self->write(self->piece_.data(), got);
    });
  });
  if (!taken) close();
}

void Connection::drain() {
  enter(Phase::kDraining, kDrainTime);
  response_ = {};
  error_code ignored;
  socket_.shutdown(asio::ip::tcp::socket::shutdown_send, ignored);
  read();
}

void Connection::stream() {
  if (!server_.hasRoomForStream()) return send(refusal(status::kBusy, "Too many event streams are open."));
  enter(Phase::kStreaming, kEventTime);
  error_code ignored;
  socket_.set_option(asio::socket_base::send_buffer_size(kStreamBuffer), ignored);
  Response head;
  head.type = "text/event-stream";
  piece_ = headOf(head, false);
  is_writing_ = true;
  write(piece_.data(), piece_.size());
  read();  // until the client goes
}

void Connection::tick(Clock::time_point now) {
  if (now >= deadline_) return close();
  if (phase_ != Phase::kStreaming || is_writing_) return;
  if (event_ != server_.event_number_) {
    event_ = server_.event_number_;
    piece_ = "data: " + *server_.event_ + "\n\n";
  } else if (now - since_ >= kHeartbeat) {
    piece_ = ": quiet\n\n";
  } else {
    return;
  }
  is_writing_ = true;
  enter(Phase::kStreaming, kEventTime);
  write(piece_.data(), piece_.size());
}

}  // namespace fathom::web
