// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of tools/view and how each is attacked, by requests written out to a socket
//   nothing outside of the folder is read        "..", escaped once and twice, absolute, by links,
//                                                hidden files
//   ranges are bytes of the file                 first, middle, last, open, beyond the end, bad
//   another site's name for 127.0.0.1 reads nothing      Host of another, none, two
//   only this machine is served                  another loopback address is refused
//   nothing but GET and HEAD                     POST, PUT, DELETE
//   a taken port is one error with the way out   a second server on it
//   contents say what there is                   a folder with one of each; photographs in it and
//                                                outside, of two cases; a trajectory half rendered
//   pictures are averaged as light               black and white columns
//   squares are every n-th node                  the field's last rows and columns, its corner
//   grids and profiles are the surface           a plane, for which thinning is exact; voids

#include "tools/view/view_server.hpp"

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <string>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "tools/view/view_contents.hpp"
#include "tools/view/view_fields.hpp"
#include "tools/view/view_files.hpp"

namespace maquette::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr std::array<PageFile, 1> kPage{{{"index.html", "<title>page</title>"}}};

/// z = 0.1 x + 0.05 y; 41 x 31 nodes at 0.5 mm from (10, 20).
heightmap::ModelField plane() {
  heightmap::ModelField field{Grid<float>(31, 41), Millimetres{0.5}, Millimetres{10.0},
                              Millimetres{20.0}};
  for (std::ptrdiff_t r = 0; r < 31; ++r)
    for (std::ptrdiff_t c = 0; c < 41; ++c)
      field.z_mm(r, c) = static_cast<float>(0.1 * field.x_mm(c) + 0.05 * field.y_mm(r));
  return field;
}

/// Connects to an address of the machine; -1 if nobody listens there.
int connect_to(const char* address, int port) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_port = htons(static_cast<std::uint16_t>(port));
  ::inet_pton(AF_INET, address, &at.sin_addr);
  if (::connect(socket, reinterpret_cast<const sockaddr*>(&at), sizeof at) == 0) return socket;
  ::close(socket);
  return -1;
}

struct Answer {
  int status = 0;
  std::string head, body;
};

class View : public testing::Test {
 protected:
  View() {
    fs::create_directories(folder / "inner");
    EXPECT_TRUE(write_file(scratch / "secret.txt", "secret"));
    EXPECT_TRUE(write_file(folder / "digits.txt", "0123456789"));
    EXPECT_TRUE(write_file(folder / "inner/a b.json", "{}"));
    EXPECT_TRUE(write_file(folder / ".hidden", "hidden"));
    EXPECT_TRUE(write_file(folder / "empty.txt", ""));
    EXPECT_TRUE(heightmap::write_model_field(plane(), folder / "design.tif"));
    fs::create_symlink(scratch / "secret.txt", folder / "out.txt");
    fs::create_directory_symlink(scratch.path(), folder / "up");
    fs::create_symlink(folder / "digits.txt", folder / "in.txt");
    auto started = ViewServer::start(folder, 0, kPage);
    EXPECT_THAT(started, Succeeds());
    server = std::make_unique<ViewServer>(std::move(*started));
  }

  /// @param lines  of the head, without Host
  Answer ask(const std::string& request, const std::string& lines = "") {
    return ask_as(fmt::format("Host: 127.0.0.1:{}\r\n", server->port()), request, lines);
  }
  Answer ask_as(const std::string& host, const std::string& request,
                const std::string& lines = "") {
    const int socket = connect_to("127.0.0.1", server->port());
    EXPECT_GE(socket, 0);
    const std::string text =
        fmt::format("{} HTTP/1.1\r\n{}{}Connection: close\r\n\r\n", request, host, lines);
    EXPECT_EQ(::send(socket, text.data(), text.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(text.size()));
    std::string all;
    std::array<char, 4096> part{};
    for (ssize_t n = 0; (n = ::recv(socket, part.data(), part.size(), 0)) > 0;)
      all.append(part.data(), static_cast<std::size_t>(n));
    ::close(socket);
    const std::size_t end = all.find("\r\n\r\n");
    Answer answer;
    EXPECT_NE(end, std::string::npos) << all;
    if (end == std::string::npos) return answer;
    answer.head = all.substr(0, end + 2);
    answer.body = all.substr(end + 4);
    answer.status = std::stoi(all.substr(9, 3));
    return answer;
  }

  ScratchFolder scratch;
  fs::path folder = scratch / "site";
  std::unique_ptr<ViewServer> server;
};

TEST_F(View, GivesThePageAndFilesWithTheirTypes) {
  const Answer page = ask("GET /");
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.body, "<title>page</title>");
  EXPECT_THAT(page.head, AllOf(HasSubstr("Content-Type: text/html"),
                               HasSubstr("Content-Security-Policy: default-src 'self'"),
                               HasSubstr("X-Content-Type-Options: nosniff")));
  const Answer file = ask("GET /files/inner/a%20b.json");
  EXPECT_EQ(file.body, "{}");
  EXPECT_THAT(file.head, HasSubstr("Content-Type: application/json"));
  EXPECT_EQ(ask("GET /files/in.txt").body, "0123456789");
  const Answer empty = ask("GET /files/empty.txt");
  EXPECT_EQ(empty.status, 200);
  EXPECT_EQ(empty.body, "");
  EXPECT_EQ(ask("GET /files/nothing.txt").status, 404);
  EXPECT_EQ(ask("GET /nothing.js").status, 404);
  EXPECT_EQ(ask("GET /files/inner").status, 404);
  EXPECT_STREQ(mime_type("tiles/0/0/0.glb"), "model/gltf-binary");
  EXPECT_STREQ(mime_type("decoder.wasm"), "application/wasm");
  EXPECT_STREQ(mime_type("scan.e57"), "application/octet-stream");
}

TEST_F(View, ReadsNothingOutsideOfTheFolder) {
  for (const char* path :
       {"/files/../secret.txt", "/files/%2e%2e/secret.txt", "/files/..%2fsecret.txt",
        "/files/%252e%252e/secret.txt", "/files/inner/../../secret.txt", "/files/out.txt",
        "/files/up/secret.txt", "/files//etc/passwd", "/files/%2fetc/passwd", "/files/./digits.txt",
        "/files/.hidden", "/files/", "/files/digits.txt%00.json", "/files/..\\secret.txt",
        "/../secret.txt", "/files/inner/%2e%2e/%2e%2e/secret.txt"}) {
    const Answer answer = ask(fmt::format("GET {}", path));
    EXPECT_EQ(answer.status, 404) << path;
    EXPECT_THAT(answer.body, Not(HasSubstr("secret"))) << path;
    EXPECT_THAT(answer.body, Not(HasSubstr("root:"))) << path;
  }
  for (const char* file : {"../secret.txt", "up/secret.txt", "/etc/passwd"})
    EXPECT_EQ(ask(fmt::format("GET /grid?file={}&nodes=8", file)).status, 404) << file;
  // The same by the function itself, for what a library may refuse before it.
  const fs::path root = fs::canonical(folder);
  EXPECT_TRUE(file_below(root, "digits.txt"));
  for (const char* path : {"", ".", "..", "../site/digits.txt", "inner/../digits.txt",
                           "/etc/passwd", "out.txt", "up/secret.txt", ".hidden", "inner", "inner/"})
    EXPECT_FALSE(file_below(root, path)) << path;
  EXPECT_FALSE(file_below(root, std::string_view("digits.txt\0.json", 16)));
}

TEST_F(View, GivesRanges) {
  const auto range = [&](const char* text) {
    return ask("GET /files/digits.txt", fmt::format("Range: bytes={}\r\n", text));
  };
  const Answer middle = range("2-5");
  EXPECT_EQ(middle.status, 206);
  EXPECT_EQ(middle.body, "2345");
  EXPECT_THAT(middle.head, HasSubstr("Content-Range: bytes 2-5/10"));
  EXPECT_EQ(range("0-0").body, "0");
  EXPECT_EQ(range("7-").body, "789");
  EXPECT_EQ(range("-3").body, "789");
  EXPECT_EQ(range("8-100").body, "89");
  EXPECT_EQ(range("-100").body, "0123456789");
  for (const char* bad : {"10-", "10-12", "200-300", "-0"}) {
    const Answer answer = range(bad);
    EXPECT_EQ(answer.status, 416) << bad;
    EXPECT_THAT(answer.head, HasSubstr("Content-Range: bytes */10")) << bad;
  }
  EXPECT_EQ(ask("GET /files/digits.txt", "Range: bytes=5-2\r\n").status, 416);
  EXPECT_EQ(ask("GET /files/digits.txt", "Range: bytes=x\r\n").status, 416);
  const Answer head = ask("HEAD /files/digits.txt");
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.body, "");
  EXPECT_THAT(head.head, HasSubstr("Content-Length: 10"));
}

TEST_F(View, RefusesNamesOfOthersAndOtherMethods) {
  const int port = server->port();
  EXPECT_EQ(ask_as(fmt::format("Host: localhost:{}\r\n", port), "GET /").status, 200);
  for (const std::string& host :
       {fmt::format("Host: evil.example:{}\r\n", port), std::string("Host: 127.0.0.1\r\n"),
        std::string(), fmt::format("Host: 127.0.0.1:{}\r\nHost: evil.example\r\n", port),
        fmt::format("Host: 127.0.0.1:{}.evil.example\r\n", port)})
    for (const char* path : {"/", "/maquette.json", "/files/digits.txt"}) {
      const Answer answer = ask_as(host, fmt::format("GET {}", path));
      EXPECT_EQ(answer.status, 403) << host << path;
      EXPECT_THAT(answer.body, Not(HasSubstr("0123"))) << host << path;
    }
  for (const char* method : {"POST", "PUT", "DELETE", "PATCH", "OPTIONS"})
    EXPECT_EQ(ask(fmt::format("{} /files/digits.txt", method), "Content-Length: 0\r\n").status, 405)
        << method;
  EXPECT_EQ(*read_file(folder / "digits.txt"), "0123456789");
}

TEST_F(View, ListensOnOneAddressOnly) {
  const int other = connect_to("127.0.0.2", server->port());
  EXPECT_LT(other, 0);
  if (other >= 0) ::close(other);
}

TEST_F(View, SaysThatAPortIsTaken) {
  const auto second = ViewServer::start(folder, server->port(), kPage);
  EXPECT_THAT(second, FailsWith(kPortTaken));
  EXPECT_EQ(second.error().code.kind, ErrorKind::environment);
  EXPECT_THAT(second.error().message, AllOf(HasSubstr(fmt::format("port {}", server->port())),
                                            HasSubstr("--port"), HasSubstr("in use")));
  // Free again when the first has ended, at once.
  const int port = server->port();
  server.reset();
  EXPECT_THAT(ViewServer::start(folder, port, kPage), Succeeds());
}

TEST_F(View, RefusesFoldersWithNothingToShow) {
  EXPECT_THAT(ViewServer::start(scratch / "nowhere", 0, kPage), FailsWith(kFileNotFound));
  EXPECT_THAT(ViewServer::start(folder / "digits.txt", 0, kPage), FailsWith(kFileNotFound));
  EXPECT_THAT(ViewServer::start(folder / "inner", 0, kPage), FailsWith(kViewNothing));
}

TEST_F(View, SaysWhatTheFolderHolds) {
  fs::create_directories(folder / "lod/tiles/0/0");
  fs::create_directories(folder / "s1000/backplot");
  for (const char* name : {"lod/tileset.json", "lod/tileset_implicit.json", "lod/lod.json",
                           "lod/stones.json", "s1000/stones.json", "s1000/backplot/paths.json",
                           "manifest.json", "report.html", "lod/tiles/0/0/tileset.json"})
    ASSERT_TRUE(write_file(folder / name, "{}"));
  ASSERT_TRUE(heightmap::write_model_field(plane(), folder / "s1000/deviation.tif"));
  ASSERT_TRUE(write_file(folder / "s1000/scene.toml",
                         "schema = \"maquette.scene/1\"\nsurface = \"design.tif\"\n"
                         "camera_position_mm = [0, -300, 400]\ncamera_target_mm = [0, 0, 0]\n"
                         "resolution_px = [1000, 500]\npixel_pitch_um = 10\n"
                         "focal_length_mm = 50\n"));
  ASSERT_TRUE(write_file(folder / "broken.tif", "not a raster"));
  const Answer answer = ask("GET /maquette.json");
  EXPECT_EQ(answer.status, 200);
  const json j = json::parse(answer.body);
  EXPECT_EQ(j["schema"], "maquette.view/1");
  EXPECT_EQ(j["name"], "site");
  EXPECT_EQ(j["tilesets"], json::parse(R"([{"path": "lod/tileset.json", "lod": "lod/lod.json",
                                            "stones": "lod/stones.json"}])"));
  EXPECT_EQ(j["plans"], json{"s1000/stones.json"});
  EXPECT_EQ(j["paths"], json{"s1000/backplot/paths.json"});
  EXPECT_EQ(j["manifest"], "manifest.json");
  EXPECT_EQ(j["reports"], json{"report.html"});
  ASSERT_EQ(j["fields"].size(), 2U);
  EXPECT_EQ(j["fields"][0]["path"], "design.tif");
  EXPECT_EQ(j["fields"][0]["kind"], "height");
  EXPECT_EQ(j["fields"][0]["nodes"], json({41, 31}));
  EXPECT_EQ(j["fields"][0]["origin_mm"], json({10.0, 20.0}));
  EXPECT_EQ(j["fields"][1]["kind"], "signed");
  ASSERT_EQ(j["frames"].size(), 1U);
  const json& frame = j["frames"][0];
  EXPECT_EQ(frame["picture"], nullptr);
  EXPECT_EQ(frame["across_mm"], 10.0);
  EXPECT_EQ(frame["down_mm"], 5.0);
  // 3-4-5: it looks down at 53 degrees, and up in the picture is up and north.
  const auto up = frame["up"].get<std::array<double, 3>>();
  EXPECT_NEAR(up[0], 0.0, 1e-12);
  EXPECT_NEAR(up[1], 0.8, 1e-12);
  EXPECT_NEAR(up[2], 0.6, 1e-12);
}

TEST_F(View, TakesAnImplicitTilesetWhereItIsTheOnlyOne) {
  fs::create_directories(folder / "lod");
  for (const char* name : {"lod/tileset_implicit.json", "lod/lod.json", "lod/stones.json"})
    ASSERT_TRUE(write_file(folder / name, "{}"));
  const json j = json::parse(ask("GET /maquette.json").body);
  EXPECT_EQ(j["tilesets"],
            json::parse(R"([{"path": "lod/tileset_implicit.json", "lod": "lod/lod.json",
                             "stones": "lod/stones.json"}])"));
  EXPECT_EQ(j["plans"], json::array());
}

TEST_F(View, KnowsPhotographsAndTrajectories) {
  ASSERT_TRUE(write_file(folder / "way.csv",
                         "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n"
                         "0,10,20,300,1,0,0,0\n0.25,30,20,300,1,0,0,0\n"));
  ASSERT_TRUE(write_file(folder / "way.toml",
                         "schema = \"maquette.scene/1\"\nsurface = \"design.tif\"\n"
                         "trajectory = \"way.csv\"\nresolution_px = [100, 50]\n"));
  ASSERT_TRUE(write_file(folder / "fly_frames.json", R"({"frames": 2})"));
  for (const char* name : {"fly_0001.png", "in.png", "other_0002.png"})
    ASSERT_TRUE(camera::write_png(Grid<std::uint8_t>(4, 8, 128), folder / name));
  ASSERT_TRUE(camera::write_png(Grid<std::uint8_t>(4, 8, 128), scratch / "out.png"));
  const std::string photo =
      "[[photo]]\nimage = \"{}\"\ncamera_position_mm = [1, 2, 500]\nfocal_length_mm = 50\n"
      "camera_quaternion_wxyz = [1, 0, 0, 0]\nresolution_px = [8, 4]\npixel_pitch_um = 1000\n";
  const std::string text = "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\n" +
                           fmt::format(fmt::runtime(photo), "in.png") + "encoding = \"srgb\"\n" +
                           fmt::format(fmt::runtime(photo), "../out.png") + "held_out = true\n";
  ASSERT_TRUE(write_file(folder / "z.toml", text));
  ASSERT_TRUE(write_file(folder / "extended.toml", text));  // names the same pictures
  const json frames = json::parse(ask("GET /maquette.json").body)["frames"];
  ASSERT_EQ(frames.size(), 4U);
  EXPECT_EQ(frames[0]["kind"], "trajectory");
  EXPECT_EQ(frames[0]["picture"], "fly_0001.png");
  EXPECT_EQ(frames[1]["picture"], nullptr);  // not made yet
  EXPECT_EQ(frames[1]["time_s"], 0.25);
  EXPECT_EQ(frames[1]["name"], "way.toml 0002");
  // Straight down, to z = 0.
  EXPECT_EQ(frames[1]["target_mm"], json({30.0, 20.0, 0.0}));
  EXPECT_EQ(frames[1]["up"], json({0.0, 1.0, 0.0}));
  EXPECT_EQ(frames[2]["name"], "z.toml in.png");
  EXPECT_EQ(frames[2]["picture"], "in.png");
  EXPECT_EQ(frames[2]["linear"], false);
  EXPECT_EQ(frames[2]["across_mm"], 8.0);
  EXPECT_EQ(frames[3]["picture"], nullptr);  // outside of the folder
  EXPECT_EQ(frames[3]["held_out"], true);
  EXPECT_EQ(frames[3]["linear"], true);
}

TEST_F(View, PicturesAreAveragedAsLight) {
  Grid<float> half(4, 8);
  for (std::ptrdiff_t r = 0; r < 4; ++r)
    for (std::ptrdiff_t c = 0; c < 8; ++c) half(r, c) = c % 2 == 0 ? 1.0F : 0.0F;
  ASSERT_TRUE(camera::write_exr({{"Y", &half}, {"Z", &half}}, folder / "half.exr"));
  for (const char* query : {"most=4&linear=1", "most=5&linear=1"}) {
    const Answer answer = ask(fmt::format("GET /picture?file=half.exr&{}", query));
    ASSERT_EQ(answer.status, 200);
    EXPECT_THAT(answer.head, HasSubstr("image/png"));
    ASSERT_TRUE(write_file(scratch / "back.png", answer.body));
    const auto back = camera::read_image(scratch / "back.png");
    ASSERT_THAT(back, Succeeds());
    ASSERT_EQ(back->channels[0].cols(), 4);
    ASSERT_EQ(back->channels[0].rows(), 2);
    // Half of the light is 188 in sRGB.
    for (const float v : back->channels[0].cells()) EXPECT_NEAR(255.0F * v, 188.0F, 0.6F);
  }
  EXPECT_EQ(ask("GET /picture?file=half.exr&most=0").status, 400);
  EXPECT_EQ(ask("GET /picture?file=../secret.txt&most=9").status, 404);
  EXPECT_EQ(ask("GET /picture?file=digits.txt&most=9").status, 422);
}

TEST_F(View, GridsAreTheSurfaceAtEvenPlaces) {
  const Answer answer = ask("GET /grid?file=design.tif&nodes=9");
  ASSERT_EQ(answer.status, 200);
  const std::size_t at = answer.head.find("Maquette-Grid: ");
  ASSERT_NE(at, std::string::npos);
  const json shape = json::parse(answer.head.substr(at + 15, answer.head.find('\r', at) - at - 15));
  const auto rows = shape["rows"].get<std::size_t>(), cols = shape["cols"].get<std::size_t>();
  EXPECT_EQ(cols, 9U);
  EXPECT_LE(rows, 9U);
  EXPECT_EQ(shape["whole"], false);
  const double dx = shape["dx_mm"], dy = shape["dy_mm"];
  // From the first node to the last.
  EXPECT_NEAR(dx * static_cast<double>(cols - 1), 20.0, 1e-9);
  EXPECT_NEAR(dy * static_cast<double>(rows - 1), 15.0, 1e-9);
  ASSERT_EQ(answer.body.size(), 4 * rows * cols);
  for (std::size_t r = 0; r < rows; ++r)
    for (std::size_t c = 0; c < cols; ++c) {
      float z = 0.0F;
      std::memcpy(&z, answer.body.data() + 4 * (r * cols + c), 4);
      const double x = 10.0 + dx * static_cast<double>(c), y = 20.0 + dy * static_cast<double>(r);
      // Three roundings to float near 4: 5e-7.
      EXPECT_NEAR(static_cast<double>(z), 0.1 * x + 0.05 * y, 2e-6) << r << ' ' << c;
    }
  EXPECT_EQ(ask("GET /grid?file=design.tif&nodes=1").status, 400);
  EXPECT_EQ(ask("GET /grid?file=design.tif&nodes=x").status, 400);
  EXPECT_EQ(ask("GET /grid?file=nothing.tif&nodes=9").status, 404);
  const Answer broken = ask("GET /grid?file=digits.txt&nodes=9");
  EXPECT_EQ(broken.status, 422);
  EXPECT_THAT(broken.body, HasSubstr("digits.txt"));
}

TEST_F(View, ProfilesAreTheSurfaceAndNullBesideIt) {
  const Answer answer = ask("GET /profile?file=design.tif&from=11.3,21.7&to=29.1,34.2&count=50");
  ASSERT_EQ(answer.status, 200);
  const json values = json::parse(answer.body)["values"];
  ASSERT_EQ(values.size(), 50U);
  for (std::size_t i = 0; i < 50; ++i) {
    const double t = static_cast<double>(i) / 49.0;
    EXPECT_NEAR(values[i].get<double>(), 0.1 * (11.3 + t * 17.8) + 0.05 * (21.7 + t * 12.5), 2e-6);
  }
  EXPECT_EQ(json::parse(ask("GET /profile?file=design.tif&from=0,0&to=0,0&count=1").body)["values"],
            json::array({nullptr}));
  for (const char* bad : {"from=1&to=1,1&count=2", "from=1,1&to=1,1&count=0", "from=1,1&to=1,1",
                          "from=nan,1&to=1,1&count=2", "from=1,1&to=1,1&count=1e9"})
    EXPECT_EQ(ask(fmt::format("GET /profile?file=design.tif&{}", bad)).status, 400) << bad;
}

TEST(ThinnedField, MeansLeaveVoidsOut) {
  heightmap::ModelField field = plane();
  for (float& z : field.z_mm.cells()) z = 2.0F;
  for (std::ptrdiff_t c = 0; c < 41; c += 2) field.z_mm(10, c) = NAN;
  for (std::ptrdiff_t r = 20; r < 31; ++r)
    for (std::ptrdiff_t c = 20; c < 41; ++c) field.z_mm(r, c) = NAN;
  const ThinnedField thin = thinned(field, 5, true);
  EXPECT_EQ(thin.values.front(), 2.0F);
  EXPECT_TRUE(std::isnan(thin.values.back()));
  for (const float z : thin.values) EXPECT_TRUE(std::isnan(z) || z == 2.0F);
  const ThinnedField all = thinned(field, 100, false);
  EXPECT_TRUE(all.whole);
  EXPECT_EQ(all.values.size(), 31U * 41U);
}

TEST_F(View, SquaresHaveEveryNthNodeAndOneAround) {
  // 41 x 31 nodes: from column 32 in steps of 4 come 32, 36, 40; from row 24 come 24, 28, 30.
  const Answer answer = ask("GET /tile?file=design.tif&row=24&col=32&every=4&quads=3");
  ASSERT_EQ(answer.status, 200);
  ASSERT_EQ(answer.body.size(), 4U * 6 * 6);
  const std::array<int, 6> rows{20, 24, 28, 30, -1, -1}, cols{28, 32, 36, 40, -1, -1};
  const heightmap::ModelField field = plane();
  for (std::size_t r = 0; r < 6; ++r)
    for (std::size_t c = 0; c < 6; ++c) {
      float z = 0.0F;
      std::memcpy(&z, answer.body.data() + 4 * (6 * r + c), 4);
      if (rows[r] < 0 || cols[c] < 0)
        EXPECT_TRUE(std::isnan(z)) << r << ' ' << c;
      else
        EXPECT_EQ(z, field.z_mm(rows[r], cols[c])) << r << ' ' << c;
    }
  const std::vector<float> corner = every_nth(field, 0, 0, 2, 1);
  EXPECT_TRUE(std::isnan(corner[0]));
  EXPECT_TRUE(std::isnan(corner[4]));
  EXPECT_EQ(corner[5], field.z_mm(0, 0));
  EXPECT_EQ(corner[15], field.z_mm(4, 4));
  for (const char* bad :
       {"row=-1&col=0&every=1&quads=8", "row=0&col=0&every=0&quads=8",
        "row=0&col=0&every=1&quads=513", "row=0&col=0&every=1", "row=0.5&col=0&every=1&quads=8"})
    EXPECT_EQ(ask(fmt::format("GET /tile?file=design.tif&{}", bad)).status, 400) << bad;
  EXPECT_EQ(ask("GET /tile?file=../secret.txt&row=0&col=0&every=1&quads=8").status, 404);
}

TEST(FieldShelf, ReadsAFileAgainWhenItHasChanged) {
  ScratchFolder scratch;
  heightmap::ModelField field = plane();
  ASSERT_TRUE(heightmap::write_model_field(field, scratch / "a.tif"));
  FieldShelf shelf;
  const auto first = shelf.get(scratch / "a.tif");
  ASSERT_THAT(first, Succeeds());
  EXPECT_EQ(shelf.get(scratch / "a.tif")->get(), first->get());
  field.z_mm(0, 0) = 7.0F;
  ASSERT_TRUE(heightmap::write_model_field(field, scratch / "a.tif"));
  fs::last_write_time(scratch / "a.tif",
                      fs::last_write_time(scratch / "a.tif") + std::chrono::seconds(5));
  EXPECT_EQ((*shelf.get(scratch / "a.tif"))->z_mm(0, 0), 7.0F);
}

}  // namespace
}  // namespace maquette::tools
