#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include <atomic>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <random>
#include <thread>

#include "realtime/base/units.hpp"
#include "telemetry/web/access.hpp"
#include "telemetry/web/page_server.hpp"
#include "tests/support/test_data.hpp"
#include "tests/web/raw_client.hpp"

namespace fathom::web {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;
using test::answerTo, test::RawClient;

constexpr std::size_t kMaxBody = 512;
constexpr std::size_t kMostGrown = 10 << 20;  // resident memory [bytes]
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr double kMostAnswer_s = 10;  // everything takes ten times as long
#else
constexpr double kMostAnswer_s = 1;
#endif
constexpr std::string_view kPageRequest = "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";
constexpr std::string_view kPost = "POST /api/echo HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Fathom: page\r\n";

class HostileClients : public testing::Test {
 protected:
  void SetUp() override {
    write("page/index.html", "<html>page</html>");
    rlimit limit{};
    ::getrlimit(RLIMIT_NOFILE, &limit);
    limit.rlim_cur = limit.rlim_max;
    ::setrlimit(RLIMIT_NOFILE, &limit);
  }
  void write(const fs::path& name, const std::string& text) const { test::writeText(root_ / name, text); }
  void serve() {
    PageServerConfig config{.option = "--port",
                            .max_body_bytes = kMaxBody,
                            .page = root_ / "page",
                            .more_scripts = {},
                            .token = {}};
    Routes routes;
    routes.post("/api/echo", [this](const HttpRequest& request) {
      ++echoed_;
      return answer(request.body, "text/plain");
    });
    routes.get("/large-answer",
               [](const HttpRequest&) { return answer(std::string(4 << 20, 'x'), "text/plain"); });
    routes.get(
        "/slow",
        [this](const HttpRequest&) {
          std::unique_lock lock(mutex_);
          released_.wait(lock, [this] { return is_released_; });
          return answer("slow", "text/plain");
        },
        Routes::Work::kLong);
    routes.events("/api/events");
    server_.emplace(config, std::move(routes));
  }
  void release() {
    const std::lock_guard lock(mutex_);
    is_released_ = true;
    released_.notify_all();
  }
  void TearDown() override { release(); }

  // Connections that have sent this.
  static void connect(std::deque<RawClient>& clients, int port, int count, std::string_view bytes,
                      int receive_buffer = 0) {
    for (int i = 0; i < count; ++i) clients.emplace_back(port, receive_buffer).send(bytes);
  }
  // How much the server takes of a hundred parts.
  static std::size_t sendParts(RawClient& client) {
    const std::string part(1 << 20, 'x');
    std::size_t taken = 0, sent = part.size();
    for (int i = 0; i < 100 && sent == part.size(); ++i) taken += sent = client.send(part);
    return taken;
  }
  [[nodiscard]] double pageSeconds() const {
    const auto begin = Clock::now();
    const std::string page = answerTo(server_->port(), kPageRequest);
    EXPECT_NE(page.find("<html>page</html>"), std::string::npos) << page;
    return rt::secondsSince(begin);
  }
  // The page's slowest answer while `what` runs, and how much resident memory grew at most.
  struct Beside {
    double slowest_s = 0;
    std::size_t grown = 0;
  };
  Beside pageBeside(const std::function<void()>& what) {
    (void)pageSeconds();
    const std::size_t before = test::residentBytes();
    std::atomic<bool> over{false};
    std::thread other([&] {
      what();
      over = true;
    });
    Beside beside;
    do {
      beside.slowest_s = std::max(beside.slowest_s, pageSeconds());
      const std::size_t now = test::residentBytes();
      beside.grown = std::max(beside.grown, now > before ? now - before : 0);
    } while (!over);
    other.join();
    std::printf("page within %.3f s, resident memory +%.2f MB\n", beside.slowest_s,
                static_cast<double>(beside.grown) / 1e6);
    return beside;
  }
  void expectUnharmed(const Beside& beside) {
    EXPECT_LT(beside.slowest_s, kMostAnswer_s);
    EXPECT_LT(beside.grown, kMostGrown);
    EXPECT_EQ(echoed_, 0) << "a handler saw what was refused";
  }

  test::TemporaryFolder scratch_;
  fs::path root_ = scratch_.path();
  std::atomic<int> echoed_ = 0;
  std::mutex mutex_;
  std::condition_variable released_;
  bool is_released_ = false;
  std::optional<PageServer> server_;  // last: it uses the rest
};

TEST_F(HostileClients, AHeadWithoutEndIsRefusedAtItsBound) {
  serve();
  std::string many;
  for (int i = 0; i < 100'000; ++i) many += "X-" + std::to_string(i) + ": 1\r\n";
  std::string answer;
  std::size_t taken = 0;
  expectUnharmed(pageBeside([&] {
    RawClient line(server_->port());
    line.send("GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Long: ");
    taken = sendParts(line);
    answer = answerTo(server_->port(), "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n" + many);
    answerTo(server_->port(), "GET /" + std::string(100'000, 'a') + " HTTP/1.1\r\n\r\n");
  }));
  EXPECT_LT(taken, 20U << 20) << "the server read on";
  EXPECT_TRUE(answer.empty() || answer.find(" 431 ") != std::string::npos) << answer;
}

TEST_F(HostileClients, ABodyBeyondItsBoundIsRefusedHoweverItIsFramed) {
  serve();
  const std::string part(1 << 20, 'x');
  std::string plain, chunked, one_chunk;
  std::size_t taken = 0;
  expectUnharmed(pageBeside([&] {
    RawClient large(server_->port());
    large.send(std::string(kPost) + "Content-Length: 104857600\r\n\r\n");
    taken = sendParts(large);
    plain =
        answerTo(server_->port(), std::string(kPost) + "Content-Length: 513\r\n\r\n" + std::string(513, 'x'));
    std::string small;
    for (int i = 0; i < 100; ++i) small += "10\r\n0123456789abcdef\r\n";
    chunked = answerTo(server_->port(),
                       std::string(kPost) + "Transfer-Encoding: chunked\r\n\r\n" + small + "0\r\n\r\n");
    one_chunk = answerTo(server_->port(),
                         std::string(kPost) + "Transfer-Encoding: chunked\r\n\r\nffffffffffff\r\n" + part);
  }));
  EXPECT_LT(taken, 20U << 20) << "the server read on";
  EXPECT_NE(plain.find(" 413 "), std::string::npos) << plain;
  EXPECT_NE(chunked.find(" 411 "), std::string::npos) << chunked;
  EXPECT_TRUE(one_chunk.empty() || one_chunk.find(" 411 ") != std::string::npos) << one_chunk;
}

// Beast's own parser of chunks ends the program where the last chunk comes byte by byte.
TEST_F(HostileClients, ABodyInChunksIsRefusedHoweverItComes) {
  serve();
  for (const std::string& chunks : {std::string("4\r\nwhol\r\n1\r\ne\r\n0\r\n\r\n"), std::string("0\r\n\r\n"),
                                    std::string("0\r\nX: 1\r\n\r\n")}) {
    RawClient client(server_->port());
    client.send(std::string(kPost) + "Transfer-Encoding: chunked\r\n\r\n");
    for (const char byte : chunks) {
      client.send({&byte, 1});
      std::this_thread::sleep_for(2ms);
    }
    const std::string got = client.receive();
    EXPECT_NE(got.find(" 411 "), std::string::npos) << got;
  }
  EXPECT_EQ(echoed_, 0);
}

// 100 bytes of brotli or gzip can stand for a gigabyte.
TEST_F(HostileClients, ACompressedBodyIsRefusedAndNeverUnpacked) {
  serve();
  for (const std::string encoding : {"br", "gzip", "deflate", "identity"}) {
    const std::string got = answerTo(server_->port(), std::string(kPost) + "Content-Encoding: " + encoding +
                                                          "\r\nContent-Length: 4\r\n\r\n\x1f\x8b\x08");
    EXPECT_NE(got.find(" 415 "), std::string::npos) << got;
  }
  EXPECT_EQ(echoed_, 0);
}

TEST_F(HostileClients, WhatIsNoRequestIsRefused) {
  serve();
  for (const std::string& bytes :
       {std::string("\r\n\r\nnothing\r\n\r\n"), std::string("GET  HTTP/1.1\r\n\r\n"), std::string(100, '\0'),
        std::string("GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: evil.example\r\n\r\n"),
        std::string("GET /%zz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"),
        std::string("GET http://127.0.0.1/ HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"),
        std::string(kPost) + "Content-Length: 4\r\nContent-Length: 5\r\n\r\nabcde",
        std::string(kPost) + "Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n4\r\nabcd\r\n0\r\n\r\n",
        std::string(kPost) + "Content-Length: -1\r\n\r\n"}) {
    const std::string got = answerTo(server_->port(), bytes);
    EXPECT_NE(got.find(" 400 "), std::string::npos) << bytes << " -> " << got;
  }
  EXPECT_EQ(echoed_, 0);
}

TEST_F(HostileClients, AThousandDrippingConnectionsDoNotShutOutThePage) {
  serve();
  expectUnharmed(pageBeside([&] {
    std::deque<RawClient> clients;
    for (int round = 0; round < 3; ++round) {
      for (int i = 0; i < 1000; ++i) {
        if (round > 0) clients.pop_front();
        clients.emplace_back(server_->port());
        EXPECT_TRUE(clients.back().connected());
        clients.back().send(i % 3 == 0   ? ""
                            : i % 3 == 1 ? "GET / HT"
                                         : std::string(kPost) + "Content-Length: 9\r\n\r\nab");
      }
      for (int i = 0; i < 5; ++i) {
        std::this_thread::sleep_for(100ms);
        for (RawClient& client : clients) client.send("x");
      }
    }
  }));
}

// One byte a second keeps no connection open: the time is for the whole request.
TEST_F(HostileClients, ARequestThatDripsIsEndedAtItsDeadline) {
  serve();
  RawClient client(server_->port());
  const auto begin = Clock::now();
  while (!client.closesWithin(500) && rt::secondsSince(begin) < 20) client.send("G");
  std::printf("ended after %.1f s\n", rt::secondsSince(begin));
  EXPECT_LT(rt::secondsSince(begin), 13);
}

TEST_F(HostileClients, SlowReadersOfALargeFileAndOfLargeAnswersCostLittle) {
  std::string large(32 << 20, '\0');
  std::mt19937 random(1);
  for (char& c : large) c = static_cast<char>(random());
  write("page/large.tif", large);
  serve();
  expectUnharmed(pageBeside([&] {
    std::deque<RawClient> clients;
    connect(clients, server_->port(), 200, "GET /large.tif HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", 4096);
    std::this_thread::sleep_for(2s);
  }));
  const std::string whole = answerTo(server_->port(), "GET /large.tif HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n");
  EXPECT_TRUE(whole.ends_with(large));
  const std::size_t before = test::residentBytes();
  std::deque<RawClient> clients;
  connect(clients, server_->port(), 120, "GET /large-answer HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", 4096);
  std::this_thread::sleep_for(1s);
  EXPECT_LT(pageSeconds(), kMostAnswer_s);
  const std::size_t grown = test::residentBytes() - std::min(before, test::residentBytes());
  std::printf("120 unread answers of 4 MiB: resident memory +%.1f MB\n", static_cast<double>(grown) / 1e6);
  EXPECT_LT(grown, 100U << 20);  // kMaxHeldBytes, and what the heap adds
}

TEST_F(HostileClients, AnEventStreamThatIsNotReadIsDroppedAndTheOthersContinue) {
  serve();
  const std::string event(60'000, 'e');
  bool dropped = false;
  expectUnharmed(pageBeside([&] {
    std::deque<RawClient> streams;
    connect(streams, server_->port(), 40, "GET /api/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", 4096);
    const auto begin = Clock::now();
    while (!dropped && rt::secondsSince(begin) < 20) {
      for (int i = 0; i < 100; ++i) server_->publish(event + std::to_string(i));
      dropped = streams.front().closesWithin(100);
    }
  }));
  EXPECT_TRUE(dropped);
  RawClient reader(server_->port());
  reader.send("GET /api/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n");
  std::string received;
  while (received.find(event) == std::string::npos) {
    const std::string part = reader.receiveSome();
    if (part.empty()) break;
    received += part;
  }
  EXPECT_NE(received.find("data: " + event), std::string::npos);
}

TEST_F(HostileClients, LongWorkDelaysNoOtherAnswerAndIsBounded) {
  serve();
  std::deque<RawClient> clients;
  connect(clients, server_->port(), 20, "GET /slow HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n");
  EXPECT_LT(pageSeconds(), kMostAnswer_s);
  std::this_thread::sleep_for(200ms);
  release();
  int done = 0, refused = 0;
  for (RawClient& client : clients) {
    const std::string got = client.receive();
    done += got.ends_with("slow") ? 1 : 0;
    refused += got.find(" 503 ") != std::string::npos ? 1 : 0;
  }
  EXPECT_EQ(done + refused, 20);
  EXPECT_GE(done, 4);
  EXPECT_GE(refused, 10);
}

// In a process of its own, which must keep running, without spinning, while the system gives it no
// descriptor, and serve again.
TEST_F(HostileClients, WithoutDescriptorsTheServerWaitsAndContinues) {
  int ports[2], orders[2];
  ASSERT_EQ(::pipe(ports), 0);
  ASSERT_EQ(::pipe(orders), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    const rlimit low{64, 64};
    ::setrlimit(RLIMIT_NOFILE, &low);
    serve();
    const int port = server_->port();
    std::deque<int> used;
    for (int one; (one = ::dup(0)) >= 0;) used.push_back(one);
    if (::write(ports[1], &port, sizeof port) != sizeof port) ::_exit(1);
    char order = 0;
    if (::read(orders[0], &order, 1) != 1) ::_exit(2);
    for (const int one : used) ::close(one);
    rusage spent{};
    ::getrusage(RUSAGE_SELF, &spent);
    const double cpu_s = static_cast<double>(spent.ru_utime.tv_sec + spent.ru_stime.tv_sec) +
                         1e-6 * static_cast<double>(spent.ru_utime.tv_usec + spent.ru_stime.tv_usec);
    std::fprintf(stderr, "without descriptors: %.2f s of CPU in 2 s\n", cpu_s);
    if (::write(ports[1], &port, sizeof port) != sizeof port) ::_exit(1);
    if (::read(orders[0], &order, 1) != 1) ::_exit(3);
    ::_exit(cpu_s < 1 ? 0 : 4);
  }
  int port = 0;
  ASSERT_EQ(::read(ports[0], &port, sizeof port), static_cast<ssize_t>(sizeof port));
  std::deque<RawClient> clients;
  connect(clients, port, 100, "GET ");
  std::this_thread::sleep_for(2s);
  ASSERT_EQ(::write(orders[1], "g", 1), 1);
  ASSERT_EQ(::read(ports[0], &port, sizeof port), static_cast<ssize_t>(sizeof port));
  connect(clients, port, 200, "GET ");  // more than it has, idle
  const auto begin = Clock::now();
  const std::string page = answerTo(port, kPageRequest);
  std::printf("with descriptors again: page within %.3f s\n", rt::secondsSince(begin));
  EXPECT_NE(page.find("<html>page</html>"), std::string::npos) << page;
  EXPECT_LT(rt::secondsSince(begin), kMostAnswer_s);
  ASSERT_EQ(::write(orders[1], "e", 1), 1);
  int status = 0;
  ::waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
  for (const int one : {ports[0], ports[1], orders[0], orders[1]}) ::close(one);
}

}  // namespace
}  // namespace fathom::web
