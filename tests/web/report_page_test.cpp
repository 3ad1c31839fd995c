#include "telemetry/web/report_page.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iterator>

#include "tests/support/test_data.hpp"

namespace fathom::web {
namespace {

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

TEST(ReportPage, HoldsItsContentInOneFileAndNothingInItCanEndItsPlace) {
  const test::TemporaryFolder folder;
  const auto file = folder.path() / "report.html";
  samplePage().write(file);
  std::ifstream in(file);
  const std::string html{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
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
