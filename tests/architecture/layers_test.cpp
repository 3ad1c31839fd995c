#include "tests/architecture/layers.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string_view>

#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const std::filesystem::path kRoot = FATHOM_SOURCE_DIR;

void write(const std::filesystem::path& path, const std::string& text) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream(path) << text;
}

// The modules of this tree.
const Layers& layers() {
  static Violations unsaid;
  static const Layers read(kRoot, unsaid);
  EXPECT_THAT(unsaid, IsEmpty());
  return read;
}

TEST(Architecture, NoFileIncludesOneThatItsLayerForbids) {
  Violations relative;
  const IncludeEdges edges = readIncludes(kRoot, relative);
  EXPECT_THAT(relative, IsEmpty());
  EXPECT_THAT(layers().checkIncludes(edges), IsEmpty());
  // The reader sees what is certainly there.
  EXPECT_TRUE(edges.count({"recon/geometry/mesh.hpp", "recon/geometry/se3.hpp"}));
  EXPECT_TRUE(edges.count({"recon/geometry/ply.cpp", "realtime/base/input_error.hpp"}));
}

TEST(Architecture, NoFileIncludesItselfInTheEnd) {
  Violations relative;
  EXPECT_THAT(findCycles(readIncludes(kRoot, relative)), IsEmpty());
}

// What makes a mission knows nothing of what has to find it again, not even its constants: cameras, poses and
// meshes are common, and a chessboard's size.
TEST(Architecture, TheSimulatedDiveKnowsNothingOfTheEstimator) {
  const std::set<std::string_view> estimate = {"sim/score", "sim/campaign", "sim/hil", "sim/link"};
  const std::regex common("recon/geometry/.*|recon/calibration/chessboard.hpp");
  Violations relative;
  std::size_t seen = 0;
  for (const auto& [from, to] : readIncludes(kRoot, relative)) {
    if (!from.starts_with("sim/") || !to.starts_with("recon/")) continue;
    if (estimate.contains(std::string_view(from).substr(0, from.find('/', 4)))) continue;
    ++seen;
    EXPECT_TRUE(std::regex_match(to, common)) << from << " includes " << to;
  }
  EXPECT_GT(seen, 30U);
}

TEST(Architecture, NoTargetLinksOneThatItsLayerForbids) {
  const auto targets = readTargets(FATHOM_TARGETS_FILE);
  EXPECT_THAT(checkTargets(layers(), targets), IsEmpty());
  ASSERT_TRUE(targets.count("fathom_kernel"));
  ASSERT_TRUE(targets.count("fathom_geometry"));
  EXPECT_EQ(targets.at("fathom_geometry").folder, "recon/geometry");
  EXPECT_TRUE(targets.at("fathom_geometry").libraries.count("fathom_kernel"));
}

TEST(Architecture, ModulesWithoutThreadsNameNone) {
  const std::regex threads(
      R"(#include\s*<(thread|atomic|mutex|shared_mutex|future|condition_variable|semaphore|latch|barrier|stop_token|pthread\.h|.*tbb/.*)>)");
  std::size_t files = 0;
  std::stringstream modules(FATHOM_THREADLESS);
  for (std::string module; std::getline(modules, module, ' ');)
    for (const auto& entry : std::filesystem::recursive_directory_iterator(kRoot / "recon" / module)) {
      if (entry.path().extension() != ".cpp" && entry.path().extension() != ".hpp") continue;
      ++files;
      EXPECT_FALSE(std::regex_search(readText(entry.path()), threads)) << entry.path();
    }
  EXPECT_GT(files, 100u);
}

// Calls `visit` with the name and text of every C++ file of the five folders and, with `tests`, of the tests.
template <typename Visit>
void forEachText(bool tests, const Visit& visit) {
  for (const char* folder : {"firmware_if", "realtime", "recon", "telemetry", "sim", "tests"})
    for (const auto& entry : std::filesystem::recursive_directory_iterator(kRoot / folder)) {
      const auto extension = entry.path().extension();
      if ((extension != ".cpp" && extension != ".hpp") || (!tests && std::string_view(folder) == "tests"))
        continue;
      visit(entry.path().lexically_relative(kRoot).generic_string(), readText(entry.path()));
    }
}

TEST(Architecture, FactorsBetweenUnitsStandInOneHeader) {
  const std::regex factor(
      R"((numbers::pi|M_PI)\s*/\s*180\b|\b180(\.0)?\s*/\s*(std::numbers::pi|M_PI)|constexpr[^;=]*(Sec|Nano|Ns|_ns)[^;=]*=\s*(1e9|1'000'000'000(LL)?)\s*;)");
  // clock_overlay is laid over programs that are not ours, without any header of ours.
  const std::set<std::string> exempt{"realtime/base/units.hpp", "sim/hil/bench/clock_overlay.cpp"};
  bool in_header = false;
  forEachText(true, [&](const std::string& name, const std::string& text) {
    std::smatch found;
    if (!std::regex_search(text, found, factor)) return;
    in_header = in_header || name == "realtime/base/units.hpp";
    if (exempt.count(name) == 0)
      ADD_FAILURE() << name << ": \"" << found.str() << "\": use realtime/base/units.hpp";
  });
  EXPECT_TRUE(in_header);
}

TEST(Architecture, ATypeOfAPublicHeaderHasANameOfItsOwn) {
  const std::regex declared(
      R"((?:^|\n)(?:enum class|enum|class|struct|using) (\w+)(?: final)?(?: :[^;{]*)?(?: \{| =))");
  std::map<std::string, std::string> header_of;
  forEachText(false, [&](const std::string& name, const std::string& text) {
    if (!name.ends_with(".hpp")) return;
    for (std::sregex_iterator type(text.begin(), text.end(), declared), end; type != end; ++type) {
      const auto [first, is_new] = header_of.insert({(*type)[1], name});
      EXPECT_TRUE(is_new || first->second == name)
          << first->first << " is in " << first->second << " and in " << name;
    }
  });
  EXPECT_EQ(header_of["SE3"], "recon/geometry/se3.hpp");
}

TEST(Layers, EachModuleKnowsItselfAndLowerLayers) {
  const auto may = [](const std::string& from, const std::string& to) {
    return mayKnow(layers().placeOf(from).value(), layers().placeOf(to).value());
  };
  EXPECT_TRUE(may("recon/geometry/a.cpp", "realtime/kernel/b.hpp"));
  EXPECT_TRUE(may("recon/stereo/a.cpp", "recon/stereo/detail/b.hpp"));
  EXPECT_TRUE(may("firmware_if/a.cpp", "recon/geometry/b.hpp"));
  EXPECT_TRUE(may("sim/a.cpp", "telemetry/b.hpp"));
  EXPECT_TRUE(may("sim/a.cpp", "recon/fusion/b.hpp"));
  EXPECT_TRUE(may("sim/replay_command.cpp", "realtime/onboard/b.hpp"));
  EXPECT_TRUE(may("telemetry/monitor/a.cpp", "telemetry/b.hpp"));
  EXPECT_TRUE(may("telemetry/monitor/a.cpp", "telemetry/web/b.hpp"));
  EXPECT_TRUE(may("recon/topside/viewer/a.cpp", "telemetry/web/b.hpp"));
  EXPECT_TRUE(may("firmware_if/main.cpp", "firmware_if/b.hpp"));
  EXPECT_TRUE(may("firmware_if/sensors_main.cpp", "telemetry/b.hpp"));

  EXPECT_FALSE(may("realtime/kernel/a.cpp", "recon/geometry/b.hpp"));
  EXPECT_FALSE(may("recon/geometry/a.cpp", "recon/stereo/b.hpp"));
  EXPECT_FALSE(may("recon/stereo/a.cpp", "recon/fusion/b.hpp"));
  EXPECT_FALSE(may("recon/navigation/a.cpp", "firmware_if/b.hpp"));
  EXPECT_FALSE(may("firmware_if/a.cpp", "telemetry/b.hpp"));
  EXPECT_FALSE(may("telemetry/a.cpp", "telemetry/monitor/b.hpp"));
  EXPECT_FALSE(may("telemetry/a.cpp", "telemetry/web/b.hpp"));
  EXPECT_FALSE(may("telemetry/web/a.cpp", "telemetry/b.hpp"));
  EXPECT_FALSE(may("recon/fusion/a.cpp", "telemetry/web/b.hpp"));
  EXPECT_FALSE(may("realtime/onboard/a.cpp", "recon/topside/b.hpp"));
  for (const char* production :
       {"telemetry/a.cpp", "telemetry/monitor/a.cpp", "telemetry/monitor/main.cpp", "realtime/onboard/a.cpp",
        "realtime/onboard/main.cpp", "recon/topside/main.cpp", "firmware_if/sensors_main.cpp"})
    EXPECT_FALSE(may(production, "sim/link/b.hpp")) << production;
  EXPECT_FALSE(may("firmware_if/a.cpp", "firmware_if/sensors_main.cpp"));
}

TEST(Layers, WhatIsInNoModuleHasNoPlace) {
  EXPECT_FALSE(layers().placeOf("tests/support/a.hpp"));
  EXPECT_FALSE(layers().placeOf("recon/a.hpp"));
  EXPECT_FALSE(layers().placeOf("realtime/a.hpp"));
  EXPECT_FALSE(layers().placeOf("realtime/elsewhere/a.hpp"));
}

TEST(Layers, AFolderThatDoesNotSayItsPlaceIsFound) {
  const TemporaryFolder tree;
  write(tree.path() / "sim/README.md", "# sim (layer 4): the sea\n");
  write(tree.path() / "sim/sea/README.md", "# sim/sea (part of sim)\n");
  write(tree.path() / "sim/hil/README.md", "# sim/hil (part of firmware_if)\n");
  write(tree.path() / "recon/README.md", "# Reconstruction\n");
  write(tree.path() / "recon/nav/README.md", "# recon/slam (layer 2)\n");
  Violations violations;
  const Layers read(tree.path(), violations);
  EXPECT_THAT(violations, ElementsAre(HasSubstr("recon/README.md"), HasSubstr("recon/nav/README.md"),
                                      HasSubstr("sim/hil/README.md")));
  EXPECT_EQ(read.placeOf("sim/sea/a.cpp").value().layer, 4);
}

TEST(Layers, AForbiddenIncludeIsFoundInATree) {
  const TemporaryFolder tree;
  for (const char* module :
       {"recon/navigation", "recon/stereo", "recon/geometry", "firmware_if", "telemetry"})
    write(
        tree.path() / module / "README.md",
        "# " + std::string(module) + (module == std::string("recon/geometry") ? " (layer 1)" : " (layer 2)"));
  write(tree.path() / "recon/navigation/good.cpp",
        "#include \"recon/geometry/se3.hpp\"\n#include <vector>\n");
  write(tree.path() / "recon/navigation/bad.cpp", "  #  include <recon/stereo/match.hpp>\n");
  write(tree.path() / "firmware_if/bad.hpp", "#include \"firmware_if/../telemetry/frame.hpp\"\n");
  write(tree.path() / "telemetry/near.hpp", "");
  write(tree.path() / "telemetry/bad.cpp",
        "#include \"near.hpp\"\n#include \"tests/support/test_data.hpp\"\n");
  std::filesystem::create_directories(tree.path() / "tests");
  Violations relative;
  const IncludeEdges edges = readIncludes(tree.path(), relative);
  EXPECT_THAT(relative, ElementsAre(HasSubstr("telemetry/bad.cpp includes \"near.hpp\"")));
  EXPECT_THAT(Layers(tree.path(), relative).checkIncludes(edges),
              ElementsAre(HasSubstr("firmware_if/bad.hpp"), HasSubstr("recon/navigation/bad.cpp"),
                          HasSubstr("telemetry/bad.cpp includes tests/support/test_data.hpp")));
}

TEST(Layers, ACycleOfIncludesIsFound) {
  EXPECT_THAT(findCycles({{"a", "b"}, {"b", "c"}, {"c", "a"}, {"d", "a"}, {"c", "e"}}),
              ElementsAre("a -> b -> c -> a"));
  EXPECT_THAT(findCycles({{"a", "b"}, {"a", "c"}, {"b", "d"}, {"c", "d"}}), IsEmpty());
  EXPECT_THAT(findCycles({{"a", "a"}}), ElementsAre("a -> a"));
}

TEST(Layers, AForbiddenLinkIsFoundThroughGeneratorExpressionsToo) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "targets.txt";
  write(file,
        "k|STATIC_LIBRARY|realtime/kernel|Threads::Threads\n"
        "g|STATIC_LIBRARY|recon/geometry|k;Eigen3::Eigen\n"
        "stereo|STATIC_LIBRARY|recon/stereo|g;$<LINK_ONLY:fusion>\n"
        "fusion|STATIC_LIBRARY|recon/fusion|g\n"
        "core|STATIC_LIBRARY|realtime/onboard|stereo;fusion\n"
        "fathom-onboard|EXECUTABLE|realtime/onboard|core;sim\n"
        "fathom-sim|EXECUTABLE|sim|sim;core\n"
        "sim|STATIC_LIBRARY|sim|g;support\n"
        "support|STATIC_LIBRARY|tests/support|\n"
        "some_test|EXECUTABLE|tests/navigation|core;support\n");
  EXPECT_THAT(checkTargets(layers(), readTargets(file)),
              ElementsAre(HasSubstr("fathom-onboard"), HasSubstr("sim links support"), HasSubstr("stereo")));
}

TEST(Layers, AMissingListOfTargetsIsAnError) {
  EXPECT_THROW(readTargets("/nonexistent/targets.txt"), std::runtime_error);
}

}  // namespace
}  // namespace fathom::test
