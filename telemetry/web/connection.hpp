#pragma once

#include <array>
#include <boost/asio/ip/tcp.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "telemetry/web/exchange.hpp"

namespace fathom::web {

class HttpServer;

// One client's connection: reads one request, sends one answer, and ends. Runs on the server's thread, but
// for handlers and file reads, which run in its pools. It holds a parser, two small buffers and, while
// sending, an answer; every phase has a deadline.
class Connection : public std::enable_shared_from_this<Connection> {
 public:
  using Clock = std::chrono::steady_clock;
  enum class Phase {
    kDraining,   // all is sent; further input is read and dropped, so that the client gets the answer
    kReading,    // the request is not whole
    kSending,    // the answer
    kHandling,   // a handler works, or waits for its turn
    kStreaming,  // server-sent events
    kClosed,
  };

  Connection(HttpServer& server, boost::asio::ip::tcp::socket socket);
  void start();
  void close();
  // Closes an overdue connection; sends a stream its next event. Called every kTick.
  void tick(Clock::time_point now);

  [[nodiscard]] Phase phase() const { return phase_; }
  // When the phase began; while sending, when the client last took a piece.
  [[nodiscard]] Clock::time_point since() const { return since_; }
  [[nodiscard]] bool sendsInParts() const { return sends_in_parts_; }
  [[nodiscard]] std::size_t heldBytes() const { return response_.body.size(); }

 private:
  void enter(Phase phase, Clock::duration patience);
  void read();
  void take(std::string_view bytes);
  [[nodiscard]] bool admit();
  void dispatch();
  void send(Response response);
  void sendNext();
  void write(const char* bytes, std::size_t size);
  void stream();
  void drain();
  [[nodiscard]] std::string headOf(const Response& response, bool has_length) const;

  HttpServer& server_;
  boost::asio::ip::tcp::socket socket_;
  Phase phase_ = Phase::kReading;
  Clock::time_point since_ = Clock::now(), deadline_ = Clock::time_point::max();
  RequestParser parser_;
  std::array<char, 4096> in_;
  Response response_;
  bool body_wanted_ = true, sets_cookie_ = false, sends_in_parts_ = false;
  std::string piece_;        // being sent
  std::uint64_t sent_ = 0;   // of the body [bytes]
  std::size_t drained_ = 0;  // [bytes]
  std::uint64_t event_ = 0;  // number of the one sent last
  bool is_writing_ = false;  // of a stream
};

}  // namespace fathom::web
