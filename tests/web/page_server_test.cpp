#include <gmock/gmock.h>

#include <atomic>
#include <cstdlib>
#include <iterator>

#include "telemetry/web/access.hpp"
#include "telemetry/web/page_server.hpp"
#include "telemetry/web/report_fields.hpp"
#include "tests/support/http_client.hpp"
#include "tests/support/test_data.hpp"
#include "tests/web/raw_client.hpp"

namespace fathom::web {
namespace {

namespace fs = std::filesystem;

class Pages : public testing::Test {
 protected:
  void SetUp() override {
    for (std::size_t i = 0; i < large_.size(); ++i) large_[i] = static_cast<char>(i * 7 % 251);
    write("secret.txt", "not for the browser");
    write("page/index.html", "<html>page</html>");
    write("page/parts/large.tif", large_);
    write("page/parts/empty.css", "");
  }
  void write(const fs::path& name, const std::string& text) const { test::writeText(root_ / name, text); }
  [[nodiscard]] PageServer serve(PageServerConfig config = {}) const {
    config.page = pageFolder(root_ / "page", "test");
    config.option = "--port";
    Routes routes;
    routes.post("/api/echo", [this](const HttpRequest& request) {
      ++echoed_;
      return answer(request.body, "text/plain");
    });
    return PageServer(config, std::move(routes));
  }
  test::TemporaryFolder scratch_;
  fs::path root_ = scratch_.path();
  std::string large_ = std::string(300'000, '\0');
  mutable std::atomic<int> echoed_ = 0;
};

// A page of another site can make a browser post any body, but neither the page's header nor another method
// to choose: no request may hide in the body of one that was refused.
TEST_F(Pages, NoRequestHidesInTheBodyOfARefusedOne) {
  PageServerConfig config;
  config.max_body_bytes = 100'000;
  const PageServer server = serve(config);
  const std::string hidden =
      "POST /api/echo HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Fathom: page\r\nContent-Length: 6\r\n\r\nsigned";
  for (const std::string& path : {std::string("/api/echo"), std::string("/absent")})
    for (const std::size_t whole : {std::size_t{0}, std::size_t{4096}, std::size_t{8192}}) {
      const auto head = [&](std::size_t length) {
        return "POST " + path + " HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: keep-alive\r\nContent-Length: " +
               std::to_string(length) + "\r\n\r\n";
      };
      const std::size_t ahead = head(whole + 100).size(), filler = whole > ahead ? whole - ahead : 0;
      const std::string answer =
          test::answerTo(server.port(), head(filler + hidden.size()) + std::string(filler, 'x') + hidden);
      EXPECT_NE(answer.find("403"), std::string::npos) << whole;
      EXPECT_EQ(answer.find("signed"), std::string::npos) << whole;
      EXPECT_EQ(answer.find("HTTP/1.1", 8), std::string::npos) << "one answer";
      EXPECT_EQ(echoed_, 0);
    }
}

TEST_F(Pages, APathCannotLeaveTheFolder) {
  const fs::path folder = root_ / "page";
  EXPECT_TRUE(fileInside(folder, "index.html"));
  EXPECT_TRUE(fileInside(folder, "./parts/large.tif"));
  const std::string absolute = (root_ / "secret.txt").string();
  for (const std::string_view path :
       {std::string_view("../secret.txt"), std::string_view("parts/../../secret.txt"),
        std::string_view("parts/../index.html"), std::string_view(absolute), std::string_view(""),
        std::string_view("parts"), std::string_view("..\\secret.txt"), std::string_view("parts/\0.tif", 11),
        std::string_view("parts/absent.tif")})
    EXPECT_FALSE(fileInside(folder, path)) << path;
}

TEST_F(Pages, OnlyPagesOfThisMachineAreAnswered) {
  const PageServer server = serve();
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_EQ(client.Get("/")->status, 200);
  EXPECT_EQ(client.Get("/", {{"Host", "evil.example"}})->status, 403);
}

TEST_F(Pages, EveryAnswerForbidsKeepingFramingAndGuessing) {
  const PageServer server = serve();
  httplib::Client client("127.0.0.1", server.port());
  for (const char* path : {"/", "/absent.js"}) {
    const auto answer = client.Get(path);
    EXPECT_EQ(answer->get_header_value("Cache-Control"), "no-store") << path;
    EXPECT_EQ(answer->get_header_value("X-Content-Type-Options"), "nosniff") << path;
    EXPECT_EQ(answer->get_header_value("X-Frame-Options"), "DENY") << path;
    EXPECT_EQ(answer->get_header_value("Referrer-Policy"), "no-referrer") << path;
    EXPECT_EQ(answer->get_header_value("Cross-Origin-Resource-Policy"), "same-origin") << path;
    const std::string policy = answer->get_header_value("Content-Security-Policy");
    EXPECT_NE(policy.find("default-src 'none'; script-src 'self'; connect-src 'self' "), std::string::npos)
        << path;
    EXPECT_EQ(policy.find("unsafe"), std::string::npos) << path;
  }
}

TEST_F(Pages, FilesHaveTheirTypesAndNothingElseIsServed) {
  const PageServer server = serve();
  httplib::Client client("127.0.0.1", server.port());
  const auto page = client.Get("/");
  EXPECT_EQ(page->body, "<html>page</html>");
  EXPECT_EQ(page->get_header_value("Content-Type"), "text/html; charset=utf-8");
  EXPECT_EQ(client.Get("/index.html")->body, page->body);
  EXPECT_EQ(client.Get("/parts/empty.css")->get_header_value("Content-Type"), "text/css");
  for (const char* path : {"/absent.json", "/parts/", "/..%2fsecret.txt", "/../secret.txt"})
    EXPECT_EQ(client.Get(path)->status, 404) << path;
}

TEST_F(Pages, PartsOfAFileAreServed) {
  const PageServer server = serve();
  httplib::Client client("127.0.0.1", server.port());
  EXPECT_EQ(client.Get("/parts/large.tif")->body, large_);
  const auto part = client.Get("/parts/large.tif", {httplib::make_range_header({{65'000, 199'999}})});
  EXPECT_EQ(part->status, 206);
  EXPECT_EQ(part->body, large_.substr(65'000, 135'000));
  const auto tail = client.Get("/parts/large.tif", {httplib::make_range_header({{262'144, 327'679}})});
  EXPECT_EQ(tail->status, 206);
  EXPECT_EQ(tail->body, large_.substr(262'144)) << "a range is cut at the file's end";
  EXPECT_EQ(client.Get("/parts/large.tif", {httplib::make_range_header({{262'144, -1}})})->body,
            large_.substr(262'144));
  EXPECT_EQ(client.Get("/parts/large.tif", {{"Range", "bytes=-1000"}})->body, large_.substr(299'000));
  EXPECT_EQ(part->get_header_value("Content-Range"), "bytes 65000-199999/300000");
  for (const char* beyond : {"bytes=300000-300010", "bytes=300000-", "bytes=-0"})
    EXPECT_EQ(client.Get("/parts/large.tif", {{"Range", beyond}})->status, 416) << beyond;
  for (const char* none :
       {"bytes=5-4", "bytes=a-b", "bytes=-", "lines=1-2", "bytes=0-1,5-6", "bytes=99999999999999999999-1"})
    EXPECT_EQ(client.Get("/parts/large.tif", {{"Range", none}})->body.size(), large_.size()) << none;
  EXPECT_EQ(client.Get("/parts/large.tif", {{"Range", "bytes=-999999"}})->body, large_);
  EXPECT_EQ(client.Get("/parts/empty.css", {{"Range", "bytes=0-"}})->status, 416);
  const auto head = client.Head("/parts/large.tif");
  EXPECT_EQ(head->get_header_value("Content-Length"), "300000");
  EXPECT_EQ(head->body, "");
}

TEST_F(Pages, WhatIsPostedNeedsThePagesHeaderAndStaysInItsBounds) {
  PageServerConfig config;
  config.max_body_bytes = 8;
  const PageServer server = serve(config);
  httplib::Client client("127.0.0.1", server.port());
  const httplib::Headers page{{kPageHeader, "page"}};
  EXPECT_EQ(client.Post("/api/echo", "short", "text/plain")->status, 403);
  EXPECT_EQ(client.Post("/api/echo", page, "short", "text/plain")->body, "short");
  EXPECT_EQ(client.Post("/api/echo", page, "much too long", "text/plain")->status, 413);
  EXPECT_EQ(client.Post("/index.html", page, "x", "text/plain")->status, 404);
}

TEST_F(Pages, WhatCannotBeServedIsNamed) {
  EXPECT_THROW((void)pageFolder(root_ / "absent", "test"), InputError);
  const PageServer server = serve();
  PageServerConfig same;
  same.port = server.port();
  EXPECT_THROW((void)serve(same), InputError);
}

constexpr const char* kToken = "0123456789abcdef";

TEST(Access, WithATokenNothingEntersWithoutIt) {
  const Access access(kToken);
  const auto judge = [&](std::string_view cookie, std::string_view header, std::string_view query) {
    return access.judge({"GET", "ship.example:8080", cookie, header, query, "", false});
  };
  EXPECT_EQ(judge("", "", ""), AccessVerdict::kUnauthorised);
  EXPECT_EQ(judge("", "", "0123456789abcdeF"), AccessVerdict::kUnauthorised);
  EXPECT_EQ(judge("", "", "0123456789abcdef0123456789abcdef"), AccessVerdict::kUnauthorised);
  EXPECT_EQ(judge("fathom_token=0123456789abcde; other=1", "", ""), AccessVerdict::kUnauthorised);
  EXPECT_EQ(judge("not_fathom_token=0123456789abcdef", "", ""), AccessVerdict::kUnauthorised);
  EXPECT_EQ(judge("a=b; fathom_token=0123456789abcdef", "", ""), AccessVerdict::kEnter);
  EXPECT_EQ(judge("", kToken, ""), AccessVerdict::kEnter);
  EXPECT_EQ(judge("", "", kToken), AccessVerdict::kEnterAndSetCookie);
}

TEST(Access, WhatChangesSomethingNeedsThePagesOwnHeader) {
  const Access with(kToken), without("");
  EXPECT_EQ(with.judge({"POST", "h", "fathom_token=0123456789abcdef", "", "", "", false}),
            AccessVerdict::kForbidden);
  EXPECT_EQ(with.judge({"POST", "h", "fathom_token=0123456789abcdef", "", "", "", true}),
            AccessVerdict::kEnter);
  EXPECT_EQ(without.judge({"POST", "127.0.0.1:80", "", "", "", "", false}), AccessVerdict::kForbidden);
  EXPECT_EQ(without.judge({"DELETE", "127.0.0.1:80", "", "", "", "", false}), AccessVerdict::kForbidden);
  EXPECT_EQ(without.judge({"POST", "127.0.0.1:80", "", "", "", "", true}), AccessVerdict::kEnter);
  EXPECT_EQ(without.judge({"POST", "127.0.0.1:80", "", "", "", "same-origin", true}), AccessVerdict::kEnter);
  for (const char* site : {"cross-site", "same-site"})
    EXPECT_EQ(without.judge({"POST", "127.0.0.1:80", "", "", "", site, true}), AccessVerdict::kForbidden);
}

TEST(Access, WithoutATokenOnlyThisMachinesNamesEnter) {
  const Access access("");
  const auto judge = [&](std::string_view host) {
    return access.judge({"GET", host, "", "", "", "", false});
  };
  for (const char* host : {"127.0.0.1:8080", "localhost", "[::1]:8080", "127.9.9.9"})
    EXPECT_EQ(judge(host), AccessVerdict::kEnter) << host;
  for (const char* host : {"", "evil.example", "127.0.0.1.evil.example", "[::1", "[", "localhost.evil:80"})
    EXPECT_EQ(judge(host), AccessVerdict::kForbidden) << host;
  EXPECT_NE(makeToken(), makeToken());
  EXPECT_EQ(makeToken().size(), 32U);
}

TEST(Access, ATokenComesFromAFileOfOneLine) {
  const test::TemporaryFolder folder;
  const auto file = folder.path() / "token";
  const auto read = [&](const std::string& text, std::string& warning) {
    test::writeText(file, text);
    return readToken(file, warning);
  };
  std::string warning;
  EXPECT_EQ(read("0123456789abcdef\n", warning), kToken);
  EXPECT_NE(warning, "") << "others may read it";
  std::filesystem::permissions(file, std::filesystem::perms::owner_all);
  warning.clear();
  EXPECT_EQ(read(kToken, warning), kToken);
  EXPECT_EQ(warning, "");
  for (const std::string& bad : {std::string(), std::string("short"), std::string("two lines\nand more"),
                                 std::string("0123456789abcdef\n\n"), std::string(129, 'x'),
                                 std::string(10'000, 'x'), std::string("header\r\nX: 1")})
    EXPECT_THROW((void)read(bad, warning), InputError) << bad;
  EXPECT_THROW((void)readToken(folder.path() / "absent", warning), InputError);
  EXPECT_THROW((void)readToken(folder.path(), warning), InputError);
}

// A picture of one pixel.
constexpr unsigned char kPixel[] = {0x89, 'P',  'N',  'G',  '\r', '\n', 0x1a, '\n', 0,    0,    0,    13,
                                    'I',  'H',  'D',  'R',  0,    0,    0,    1,    0,    0,    0,    1,
                                    8,    6,    0,    0,    0,    0x1f, 0x15, 0xc4, 0x89, 0,    0,    0,
                                    13,   'I',  'D',  'A',  'T',  0x78, 0xda, 0x63, 0x64, 0xf8, 0xcf, 0x50,
                                    0x0f, 0x00, 0x03, 0x86, 0x01, 0x80, 0x5a, 0x34, 0x7d, 0x6b, 0,    0,
                                    0,    0,    'I',  'E',  'N',  'D',  0xae, 0x42, 0x60, 0x82};

ReportPage samplePage() {
  ReportPage report("A dive </script> & more", "of a test");
  report.section("Words");
  report.text("plain");
  report.warning("loud");
  report.list({"one", "two"});
  report.list({});
  report.table({}, {{"pairs", "8"}, {"off [px]", Cell("0.5", 0.5)}});
  report.section("Nothing");
  report.section("Figures");
  report.picture(std::string_view(reinterpret_cast<const char*>(kPixel), sizeof(kPixel)), "A picture");
  Series path{.label = "track", .colour = "#ff0000", .at = {{0, 0}, {5, 1}}, .size = 3};
  path.lift();
  path.at.insert(path.at.end(), {{2, 4}, {3, 4}});
  Series box{.kind = Series::Kind::kAreas, .colour = "#0000ff"};
  box.rectangle({1, 1}, {3, 2});
  report.plot({.title = "Track",
               .x = "east [m]",
               .y = "north [m]",
               .series = {path, box, {.label = "none", .kind = Series::Kind::kDots}},
               .equal = true,
               .down = true});
  report.plot({.title = "Decades",
               .x = "x",
               .y = "y",
               .series = {{.at = {{1, 10}, {100, 1000}}}},
               .log_x = true,
               .log_y = true});
  return report;
}

TEST(ReportFields, DescribeEachFigureOnceForFileAndPage) {
  const Fields fields = {{"pairs", 8, "pairs listed"},
                         {"content", "0a"},
                         {"fit", Fields{{"rms_m", 0.0015, "rms [mm]", 1, 1e3}, onPage("off", "left")}},
                         {"truth", Fields{}}};
  EXPECT_EQ(jsonOf(fields).dump(), R"({"pairs":8,"content":"0a","fit":{"rms_m":0.0015},"truth":null})");
  std::string page;
  for (const Row& row : rowsOf(named("dive", "3", fields))) page += row[0].text + ": " + row[1].text + "\n";
  EXPECT_EQ(page, "dive: 3\npairs listed: 8\nrms [mm]: 1.5\noff: left\n");
}

TEST(ReportPage, HoldsItsContentInOneFileAndNothingInItCanEndItsPlace) {
  const test::TemporaryFolder folder;
  const auto file = folder.path() / "report.html";
  samplePage().write(file);
  const std::string html = test::readText(file);
  EXPECT_THAT(html, testing::HasSubstr(R"({"title":"A dive \u003c/script> & more")"));
  EXPECT_THAT(html, testing::Not(testing::HasSubstr("FATHOM_CONTENT")));
  EXPECT_THAT(html, testing::Not(testing::HasSubstr("Nothing"))) << "a section without parts";
  EXPECT_THAT(html, testing::HasSubstr(R"("x":[0.0,5.0,null,2.0,3.0])"));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1) << "no temporary file";
  // For the test in a browser.
  if (const char* kept = std::getenv("FATHOM_TEST_REPORT")) samplePage().write(kept);
}

TEST(ReportPage, HistogramCountsEveryValueAndTheOutermostBarsHoldWhatIsBeyond) {
  const Plot plot = histogram({-9, 0.1, 0.9, 1.5, 7}, 0, 2, 2, "m", "of five");
  ASSERT_EQ(plot.series.size(), 1U);
  const auto& at = plot.series[0].at;  // four corners a bar, and a lift
  ASSERT_EQ(at.size(), 10U);
  EXPECT_EQ(at[2].y(), 3);
  EXPECT_EQ(at[7].y(), 2);
  EXPECT_FALSE(at[4].allFinite());
}

}  // namespace
}  // namespace fathom::web
