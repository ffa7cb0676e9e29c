// SPDX-License-Identifier: GPL-3.0-or-later

// The commands scan and merge from outside: a scanner's file is written, edited, read, and refused
// with its line; every cloud format; two displaced scans become one cloud and a mesh.

#include <array>
#include <cmath>
#include <cstdio>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "core/random.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "scan/cloud_stream.hpp"
#include "support/browser.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;
using testing_support::Outcome;
using testing_support::run_program;
using testing_support::ScratchFolder;
using testing_support::slurp;

class ScanCommand : public testing::Test {
 protected:
  ScratchFolder scratch;
  Outcome run(const std::string& arguments) {
    return run_program(scratch.path(), arguments, "cd '" + scratch.path().string() + "' &&");
  }
  void SetUp() override {
    ASSERT_TRUE(heightmap::write_model_field(testing_support::rough_part(3, 151, 151, 1.0, 3.0),
                                             scratch / "design.tif"));
  }
};

TEST_F(ScanCommand, TakesScannersFromFiles) {
  const std::string f = (scratch / "my.toml").string();
  ASSERT_EQ(run("scan --write-scanner " + f).exit_code, 0);
  std::string text = slurp(scratch / "my.toml");
  EXPECT_THAT(text, HasSubstr("divergence_mrad = 0.22"));
  const auto at = text.find("lines_per_turn = 20000.0");
  ASSERT_NE(at, std::string::npos);
  text.replace(at, 24, "lines_per_turn = 4000.0");
  ASSERT_TRUE(write_file(scratch / "my.toml", text));
  const std::string common =
      "scan design.tif --station-mm 75 -300 500 --max-points 9000000 --json --quiet --out ";
  const auto coarse = json::parse(run(common + "a.ply --scanner my.toml").out);
  const auto fine = json::parse(run(common + "b.ply").out);
  EXPECT_NEAR(fine["points"].get<double>() / coarse["points"].get<double>(), 25.0, 2.0);
  // A typing error has its line; a scanner of the other kind has its own keys.
  ASSERT_TRUE(write_file(scratch / "bad.toml", "kind = \"phase_shift\"\nlines_per_tur = 3\n"));
  const Outcome bad = run("scan design.tif --scanner bad.toml");
  EXPECT_EQ(bad.exit_code, 2);
  EXPECT_THAT(bad.err, HasSubstr("bad.toml:2"));
  ASSERT_TRUE(
      write_file(scratch / "head.toml",
                 "kind = \"structured_light\"\n[camera]\nwidth_px = 200\nheight_px = 100\n"));
  const auto head = json::parse(run(common + "c.ply --scanner head.toml").out);
  EXPECT_EQ(head["stations"][0]["directions"], 20'000);
  EXPECT_EQ(run("scan").exit_code, 2) << "no surface";
}

TEST_F(ScanCommand, MergesWhatItScanned) {
  for (const char* name : {"a.e57", "b.ptx"})
    ASSERT_EQ(run(std::string("scan design.tif --max-points 40000 --seed 3 --out ") + name +
                  " --station-mm 75 " + (name[0] == 'a' ? "-250" : "400") + " 400 --quiet")
                  .exit_code,
              0);
  // The second one is brought 2 mm off, as a copy without poses.
  auto moved = scan::read_cloud(scratch / "b.ptx");
  ASSERT_TRUE(moved.has_value());
  for (Vec3& p : moved->points_mm) p += Vec3{1.0, -1.5, 1.0};
  scan::Cloud plain;
  plain.points_mm = moved->points_mm;
  ASSERT_TRUE(scan::write_cloud(plain, scratch / "b.ply"));
  const Outcome o = run("merge a.e57 b.ply --out m.e57 --mesh m.ply --json --quiet");
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json j = json::parse(o.out);
  ASSERT_EQ(j["scans"].size(), 2U);
  const double moved_mm = j["scans"][1]["moved_mm"];
  EXPECT_NEAR(moved_mm, std::sqrt(1.0 + 2.25 + 1.0), 0.15);
  EXPECT_EQ(j["pairs"].size(), 1U);
  EXPECT_GE(j["mesh"]["border_loops"].get<int>(), 1);
  EXPECT_TRUE(meshing::read_mesh(scratch / "m.ply").has_value());
  const auto info = scan::inspect_cloud(scratch / "m.e57");
  ASSERT_TRUE(info.has_value());
  EXPECT_EQ(info->stations.size(), 2U);
  EXPECT_EQ(info->points, j["points"].get<std::uint64_t>());
  EXPECT_THAT(slurp(scratch / "m.e57.merge.json"), HasSubstr("covariance"));
  ASSERT_EQ(run("merge a.e57 b.ply --out thin.ply --thin-mm 5 --quiet").exit_code, 0);
  EXPECT_EQ(run("merge a.e57 --out x.ply").exit_code, 2);
}

TEST_F(ScanCommand, CleansWhatItScanned) {
  ASSERT_EQ(run("scan design.tif --max-points 40000 --out s.e57 --quiet").exit_code, 0);
  const Outcome o = run("clean s.e57 --part design.tif --thin-mm 5 --out c.ply --json --quiet");
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json j = json::parse(o.out);
  const auto count = [&](const char* key) { return j[key].get<std::uint64_t>(); };
  EXPECT_EQ(count("points"),
            count("mixed") + count("isolated") + count("off_part") + count("kept"));
  EXPECT_EQ(count("off_part"), 0U);
  // Relief of a tenth of its length has many bends narrower than two beams.
  EXPECT_GT(static_cast<double>(count("kept")), 0.85 * static_cast<double>(count("points")));
  const auto back = scan::read_cloud(scratch / "c.ply");
  ASSERT_TRUE(back.has_value());
  EXPECT_EQ(back->points_mm.size(), count("written"));
  std::uint64_t all = 0;
  for (const std::uint32_t n : back->counts) all += n;
  EXPECT_EQ(all, count("kept"));
  EXPECT_EQ(run("clean s.e57 --thin-mm -1 --out x.ply").exit_code, 2);
}

// A scan in any frame, of a part that was clamped 0.4 mm off and turned by 0.1 degrees among four
// reference spheres, one of which was not scanned: the spheres give the pose, the part's place
// comes out in corrections.toml, and the regions of a drawing are judged.
TEST_F(ScanCommand, SpheresGiveThePoseAndThePartsPlace) {
  const auto part = heightmap::read_model_field(scratch / "design.tif");
  ASSERT_TRUE(part.has_value());
  const RigidTransform actual{rotation_about({0, 0, 1}, 0.1 * 3.14159265 / 180.0),
                              {0.4, -0.1, 0.05}};
  scan::Cloud cloud = testing_support::points_on(*part, 60'000, 5, 0.05);
  for (Vec3& p : cloud.points_mm) p = actual.point(p);
  std::string entry =
      "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\n[deviation]\nregions = "
      "\"pads.dxf\"\n";
  const std::vector<Vec3> centres{{-20, -15, 12}, {175, -10, 15}, {160, 170, 20}, {-15, 140, 9}};
  for (std::size_t k = 0; k < centres.size(); ++k) {
    entry += "[[datum]]\nkind = \"sphere\"\nname = \"S" + std::to_string(k) +
             "\"\nradius_mm = 8.0\nat_mm = [" + std::to_string(centres[k].x) + ", " +
             std::to_string(centres[k].y) + ", " + std::to_string(centres[k].z) + "]\n";
    for (std::uint64_t i = 0; i < 3'000 && k < 3; ++i) {
      const Vec3 n = normalized(
          Vec3{random_normal(k, 3 * i), random_normal(k, 3 * i + 1), random_normal(k, 3 * i + 2)});
      if (n.z > -0.2)
        cloud.points_mm.push_back(centres[k] + (8.0 + 0.05 * random_normal(k + 50, i)) * n);
    }
  }
  ASSERT_TRUE(
      write_file(scratch / "pads.dxf",
                 "0\nSECTION\n2\nENTITIES\n0\nCIRCLE\n8\nbowl\n10\n75\n20\n75\n40\n30\n"
                 "0\nTEXT\n8\nbowl\n10\n75\n20\n75\n40\n2\n1\nbowl -0.5 0.5\n0\nENDSEC\n0\nEOF\n"));
  const RigidTransform far = testing_support::random_pose(3, {75, 75, 10}, 2.0, 900.0);
  ASSERT_TRUE(scan::write_cloud(testing_support::seen_from(cloud, far), scratch / "s.ply"));
  ASSERT_TRUE(write_file(scratch / "stops.csv",
                         "position_mm,x_mm,y_mm,z_mm\n0,1,2,3\n100,101,2,3\n200,201.1,2,3\n"));
  entry += "[[axis]]\nname = \"rail\"\nstops = \"stops.csv\"\n[[scan]]\npoints = \"s.ply\"\n";
  ASSERT_TRUE(write_file(scratch / "case.toml", entry));
  const Outcome o = run("deviate case.toml --out d --quiet");
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json s = json::parse(slurp(scratch / "d" / "summary.json"));
  ASSERT_EQ(s["spheres"].size(), 1U);
  EXPECT_EQ(s["spheres"][0]["matched"], json({"S0", "S1", "S2"}));
  EXPECT_EQ(s["spheres"][0]["missing"], json({"S3"}));
  EXPECT_TRUE(s["objects"].empty()) << "spheres are no objects" << s["objects"].dump();
  EXPECT_EQ(s["regions"][0]["name"], "bowl");
  const json c = s["corrections"];
  const double sigma = c["sigma_translation_mm"];
  EXPECT_LT(sigma, 0.05);
  for (std::size_t k = 0; k < 3; ++k) {
    // Of the design's origin: beside that of the middle what 106 mm make of the rotation's.
    const double want = std::array{0.4, -0.1, 0.05}[k];
    const double arm = 106.0 * c["sigma_rotation_deg"].get<double>() * 3.14159265 / 180.0;
    EXPECT_NEAR(c["translation_mm"][k].get<double>(), want, 4.0 * std::hypot(sigma, arm)) << k;
  }
  EXPECT_NEAR(c["rotation_deg"][2].get<double>(), 0.1,
              4.0 * c["sigma_rotation_deg"].get<double>() + 1e-9);
  EXPECT_EQ(c["axes"][0]["name"], "rail");
  EXPECT_EQ(slurp(scratch / "d" / "report.pdf").substr(0, 5), "%PDF-");
  EXPECT_THAT(slurp(scratch / "d" / "corrections.toml"), HasSubstr("maquette.corrections/1"));
}

// The second of three bands lies 0.2 mm high, as one does that was milled from a datum of its own:
// its row of the table says so, by the joints of bands.json, and the others' do not.
TEST_F(ScanCommand, EachBandHasItsHeight) {
  const auto part = heightmap::read_model_field(scratch / "design.tif");
  ASSERT_TRUE(part.has_value());
  ASSERT_EQ(run("bands design.tif --count 3 --out b --quiet").exit_code, 0);
  const json bands = json::parse(slurp(scratch / "b" / "bands.json"))["bands"];
  ASSERT_EQ(bands.size(), 3U);
  const double from = bands[1]["from_mm"], to = bands[1]["to_mm"];
  scan::Cloud cloud = testing_support::points_on(*part, 90'000, 12, 0.05);
  for (Vec3& p : cloud.points_mm)
    if (p.y > from && p.y < to) p.z += 0.2;
  ASSERT_TRUE(scan::write_cloud(cloud, scratch / "s.ply"));
  ASSERT_TRUE(write_file(scratch / "case.toml",
                         "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\n[deviation]\n"
                         "bands = \"b/bands.json\"\n[[scan]]\npoints = \"s.ply\"\n"));
  ASSERT_EQ(run("deviate case.toml --out d --quiet").exit_code, 0);
  const json regions = json::parse(slurp(scratch / "d" / "summary.json"))["regions"];
  ASSERT_EQ(regions.size(), 3U);
  std::array<double, 3> mean{};
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(regions[k]["name"], "band " + std::to_string(k + 1));
    mean[k] = regions[k]["mean_mm"];
    // 3.3 times the noise of 0.05 mm and what a tilt adds; with a tenth of a neighbour's points,
    // 0.15 mm off, it would be 0.24.
    EXPECT_LT(regions[k]["p95_mm"].get<double>() - regions[k]["p05_mm"].get<double>(), 0.2) << k;
  }
  // Along the normal, of which the best fit takes what a shift along the relief can make up for.
  EXPECT_GT(mean[1] - 0.5 * (mean[0] + mean[2]), 0.12);
  EXPECT_LT(mean[1] - 0.5 * (mean[0] + mean[2]), 0.2);
  EXPECT_NEAR(mean[0], mean[2], 0.01);
}

// A strip along the rim stands 0.4 mm high: the best fit is made again without it, so the scanner
// comes out where it stood; points beside the rim have a slope, so its height along z is a figure.
TEST_F(ScanCommand, AStripAlongTheRimHasItsHeight) {
  const auto part = heightmap::read_model_field(scratch / "design.tif");
  ASSERT_TRUE(part.has_value());
  scan::Cloud cloud = testing_support::points_on(*part, 90'000, 11, 0.05);
  for (Vec3& p : cloud.points_mm)
    if (p.y > 135.0) p.z += 0.4;
  const Vec3 station{75.0, -300.0, 500.0};
  cloud.station_mm = station;
  const RigidTransform elsewhere = testing_support::random_pose(11, {75, 75, 10}, 0.01, 2.0);
  const scan::Cloud seen = testing_support::seen_from(cloud, elsewhere);
  ASSERT_TRUE(scan::write_cloud(seen, scratch / "s.ply"));
  const Vec3 at = *seen.station_mm;
  ASSERT_TRUE(
      write_file(scratch / "case.toml",
                 "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\n[[scan]]\npoints = "
                 "\"s.ply\"\nscanner_position_mm = [" +
                     std::to_string(at.x) + ", " + std::to_string(at.y) + ", " +
                     std::to_string(at.z) + "]\n"));
  const Outcome o = run("deviate case.toml --out d --quiet");
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json s = json::parse(slurp(scratch / "d" / "summary.json"));
  SCOPED_TRACE(s["findings"].dump() + s["registrations"].dump() + s["stations"].dump());
  EXPECT_TRUE(s["fitted_without_findings"].get<bool>());
  ASSERT_FALSE(s["findings"].empty());
  for (const json& f : s["findings"]) EXPECT_TRUE(f["along_z_mm"].is_number());
  // 4 points a mm^2 of 0.05 mm: 10 mm hold 314, 0.0028 mm; 7.5 of these and what cells cost.
  for (const json& limit : s["detection_limits"])
    if (limit["width_mm"] == 10.0) {
      EXPECT_NEAR(limit["height_mm"].get<double>(), 0.025, 0.005);
    }
  EXPECT_GE(s["detection_limits"].size(), 4U);
  const json f = s["findings"][0];
  EXPECT_NEAR(f["along_z_mm"].get<double>(), 0.4, 4.0 * f["sigma_height_mm"].get<double>());
  EXPECT_LT(f["sigma_height_mm"].get<double>(), 0.01);
  const json r = s["registrations"][0], found = s["stations"][0]["at_mm"];
  // The scanner stands 620 mm from the part's middle.
  const double sigma = std::hypot(r["sigma_translation_mm"].get<double>(),
                                  620.0 * r["sigma_rotation_rad"].get<double>());
  EXPECT_NEAR(found[0].get<double>(), station.x, 4.0 * sigma);
  EXPECT_NEAR(found[1].get<double>(), station.y, 4.0 * sigma);
  EXPECT_NEAR(found[2].get<double>(), station.z, 4.0 * sigma);
  EXPECT_TRUE(s["stations"][0]["incidence_deg"][0].is_number());
}

// A report of a part with a bump of 0.3 mm, 30 mm wide, in its middle: seen from above in a browser
// the middle is red, a click there tells its place and height, cutting takes half of the part away.
TEST_F(ScanCommand, TheReportsPartTurnsInABrowser) {
  if (!testing_support::browser()) GTEST_SKIP() << "no chromium here: the page is not looked at";
  const auto part = heightmap::read_model_field(scratch / "design.tif");
  ASSERT_TRUE(part.has_value());
  scan::Cloud cloud = testing_support::points_on(*part, 100'000, 5, 0.05);
  for (Vec3& p : cloud.points_mm)
    if (std::hypot(p.x - 75.0, p.y - 75.0) < 15.0) p.z += 0.3;
  ASSERT_TRUE(scan::write_cloud(cloud, scratch / "s.ply"));
  ASSERT_TRUE(write_file(scratch / "case.toml",
                         "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\n[[profile]]\nname "
                         "= \"across\"\nfrom_mm = [10, 75]\nto_mm = [140, 75]\nstep_mm = "
                         "2.0\n[[scan]]\npoints = \"s.ply\"\n"));
  const Outcome o = run("deviate case.toml --out d --quiet");
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json s = json::parse(slurp(scratch / "d" / "summary.json"));
  ASSERT_EQ(s["profiles"][0]["values"].size(), 65U);
  for (const json& v : s["profiles"][0]["values"]) {
    const double x = v["x_mm"], mean = v["mean_mm"], sigma = v["sigma_mm"];
    if (std::abs(std::abs(x - 75.0) - 15.0) < 1.1) continue;  // half in it
    // What is moved along z is less along the normal; the best fit takes 0.01 mm of it.
    const auto height = [&](double dx, double dy) {
      return heightmap::height_at(*part, x + dx, 75.0 + dy);
    };
    const double slope =
        std::hypot(height(1, 0) - height(-1, 0), height(0, 1) - height(0, -1)) / 2.0;
    EXPECT_NEAR(mean, std::abs(x - 75.0) < 15.0 ? 0.3 / std::hypot(1.0, slope) - 0.01 : -0.01,
                4.0 * sigma + 0.02)
        << x;
  }
  EXPECT_LT(std::hypot(s["worst"]["places"][0]["x_mm"].get<double>() - 75.0,
                       s["worst"]["places"][0]["y_mm"].get<double>() - 75.0),
            15.0);
  std::string page = slurp(scratch / "d" / "report.html");
  for (const char* address : {"http:", "https:", "//cdn", "import(", "fetch(", "XMLHttp"})
    EXPECT_THAT(page, testing::Not(HasSubstr(address)));
  page += R"js(<script>
addEventListener('load', () => {
  const canvas = document.getElementById('part'), gl = canvas.getContext('webgl'), out = {};
  canvas.setPointerCapture = () => {};  // there is no real pointer
  const box = () => canvas.getBoundingClientRect();
  const send = (kind, dx, dy) => canvas.dispatchEvent(new PointerEvent(kind, {pointerId: 1,
    clientX: box().left + box().width / 2 + dx, clientY: box().top + box().height / 2 + dy}));
  const look = () => {
    const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight, p = new Uint8Array(4 * w * h);
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p);
    let ink = 0;
    for (let k = 3; k < p.length; k += 4) ink += p[k] > 0 ? 1 : 0;
    const m = 4 * (Math.floor(h / 2) * w + Math.floor(w / 2));
    return {ink, middle: [...p.slice(m, m + 4)]};
  };
  const slide = (name, value) => {
    const input = document.querySelector(`input[name=${name}]`);
    input.value = value; input.dispatchEvent(new Event('input'));
  };
  out.oblique = look();
  send('pointerdown', 0, 0); send('pointermove', 0, 400); send('pointerup', 0, 400);
  out.above = look();
  send('pointerdown', 0, 0); send('pointerup', 0, 0);
  out.clicked = document.querySelector('.value').textContent;
  const corner = [-box().width / 2 + 2, -box().height / 2 + 2];
  send('pointerdown', ...corner); send('pointerup', ...corner);
  out.beside = document.querySelector('.value').textContent;
  slide('cutX', 0.3); out.cut = look(); slide('cutX', 1);
  slide('bend', 0.05); send('pointerdown', 0, 0); send('pointermove', 0, -150);
  send('pointerup', 0, -150);
  out.bent = look();
  out.bars = document.querySelectorAll('svg[aria-label="colour scale"]').length;
  out.curves = document.querySelectorAll('svg polyline').length;
  out.wide = document.documentElement.scrollWidth <= innerWidth;
  document.body.append(Object.assign(document.createElement('pre'),
    {id: 'told', textContent: JSON.stringify(out)}));
});
</script>)js";
  ASSERT_TRUE(write_file(scratch / "q.html", page));
  for (const char* size : {"1200,900", "500,800"}) {
    const json out =
        json::parse(testing_support::told_by(scratch / "q.html", size, scratch.path()));
    SCOPED_TRACE(out.dump());
    const auto ink = [&](const char* picture) { return out[picture]["ink"].get<double>(); };
    EXPECT_GT(ink("oblique"), 10'000.0);
    EXPECT_GT(ink("above"), 1.1 * ink("oblique")) << "from above more of the part is seen";
    const json red = out["above"]["middle"];
    EXPECT_GT(red[0].get<int>(), red[2].get<int>() + 60) << "the bump";
    double x = 0.0, y = 0.0, z = 0.0, d = 0.0;
    const std::string text = out["clicked"];
    ASSERT_EQ(std::sscanf(text.c_str(), "x %lf, y %lf, z %lf mm: %lf mm", &x, &y, &z, &d), 4);
    EXPECT_NEAR(x, 75.0, 3.0);
    EXPECT_NEAR(y, 75.0, 3.0);
    EXPECT_NEAR(z, heightmap::height_at(*part, x, y), 0.02);
    // A node's mean of some four points of 0.05 mm.
    EXPECT_NEAR(d, 0.29, 0.12);
    EXPECT_EQ(out["beside"], "nothing there");
    // 0.3 of the width stays; the view is turned, but from above areas keep their ratio, as far as
    // perspective and relief let them.
    EXPECT_NEAR(ink("cut") / ink("above"), 0.3, 0.03);
    EXPECT_NE(out["bent"], out["oblique"]);
    EXPECT_EQ(out["bars"], 3) << "beside each map and the part";
    EXPECT_EQ(out["curves"], 2) << "profile, normal distribution";
    EXPECT_TRUE(out["wide"]) << "nothing sticks out sideways";
  }
}

}  // namespace
}  // namespace maquette::tools
