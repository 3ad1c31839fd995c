#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <unordered_set>
#include <vector>

#include "telemetry/web/access.hpp"
#include "telemetry/web/connection.hpp"
#include "telemetry/web/exchange.hpp"

namespace fathom::web {

// A fixed number of threads that run jobs in their order. Exceptions of a job are dropped.
class WorkerPool {
 public:
  WorkerPool(std::size_t threads, std::size_t most_waiting);
  ~WorkerPool();  // finishes the running jobs; those that wait are dropped
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  // False: the queue is full.
  [[nodiscard]] bool post(std::function<void()> job);

 private:
  void work();

  const std::size_t most_waiting_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> waiting_;
  bool ending_ = false;
  std::vector<std::thread> threads_;  // last: they use the rest
};

inline WorkerPool::WorkerPool(std::size_t threads, std::size_t most_waiting) : most_waiting_(most_waiting) {
  for (std::size_t i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
}

inline WorkerPool::~WorkerPool() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

inline bool WorkerPool::post(std::function<void()> job) {
  {
    const std::lock_guard lock(mutex_);
    if (waiting_.size() >= most_waiting_) return false;
    waiting_.push_back(std::move(job));
  }
  changed_.notify_one();
  return true;
}

inline void WorkerPool::work() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return ending_ || !waiting_.empty(); });
    if (ending_) return;
    std::function<void()> job = std::move(waiting_.front());
    waiting_.pop_front();
    lock.unlock();
    try {
      job();
    } catch (const std::exception&) {
      // Out of memory to hand over the answer; the connection ends at its deadline.
    }
    job = nullptr;  // frees what it holds before the lock is taken again
    lock.lock();
  }
}

// Bounds of the memory and time that clients can take from a server.
inline constexpr std::size_t kMaxConnections = 128;
inline constexpr std::size_t kConnectionsPerStream = 8;  // one in this many may be an event stream
// Bytes of all answers in memory, without the newest and the largest: one export of any size and a page are
// still answered.
inline constexpr std::size_t kMaxHeldBytes = std::size_t{64} << 20;
inline constexpr std::chrono::seconds kRequestTime{10};  // for a request to come whole
inline constexpr std::chrono::seconds kPieceTime{30};    // for a client to take a piece of an answer
inline constexpr std::chrono::seconds kHandlerTime{300};
// Time for a client to send its request or to take a piece, before its connection may be evicted; on a busy
// machine the server itself needs some of it. A client that sends a request in parts has none.
inline constexpr std::chrono::milliseconds kGrace{60};
// Between events of a stream.
inline constexpr std::chrono::milliseconds kTick{250};

// Accepts connections and runs all of them on one thread. When kMaxConnections (or a quarter of the process's
// descriptors) are open, a new one evicts the one that has waited longest, at least kGrace, to end, to send
// its request or to take its answer. Without descriptors it waits for one. No client can end it.
class HttpServer {
 public:
  struct Config {
    std::string address;
    int port = 0;  // 0: any that is free
    std::size_t max_body_bytes = 0;
    std::string token;    // see Access
    std::string headers;  // of every answer, each with its line end
  };

  // Throws boost::system::system_error where it cannot listen.
  HttpServer(const Config& config, Routes routes);
  ~HttpServer();
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  [[nodiscard]] int port() const { return acceptor_port_; }
  // Sends a text to all event streams; the newest replaces what a slow one has not taken yet. From any
  // thread.
  void publish(std::string text);

 private:
  friend class Connection;  // the rest is for connections, on the server's thread
  enum class Evictable { kAny, kSending };

  void listen(const Config& config);
  void accept();
  void admit(boost::asio::ip::tcp::socket socket);
  void tick();
  bool evict(Evictable which, const Connection* keep);  // false: there is none to evict
  void boundHeldBytes(const Connection& newest);
  void forget(const std::shared_ptr<Connection>& connection) { connections_.erase(connection); }
  [[nodiscard]] bool hasRoomForStream() const;

  const Access access_;
  const Routes routes_;
  const std::string headers_;
  const std::size_t max_body_bytes_;
  std::shared_ptr<const std::string> event_;
  std::uint64_t event_number_ = 0;

  boost::asio::io_context io_{1};
  boost::asio::ip::tcp::acceptor acceptor_{io_};
  int acceptor_port_ = 0;
  boost::asio::steady_timer ticks_{io_}, pause_{io_};
  std::unordered_set<std::shared_ptr<Connection>> connections_;
  // Each connection waits for one job at most, so that short ones are never refused.
  WorkerPool short_work_{4, kMaxConnections}, file_reads_{2, kMaxConnections};
  WorkerPool long_work_{1, 4};
  std::thread thread_;
};

}  // namespace fathom::web
