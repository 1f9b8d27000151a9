#include <algorithm>

#include "objects.h"

namespace revisit::simulation {
namespace {

using Vec = Mesh::Vec;

/// An opening of the facade: [x0, x1] x [z0, z1], recessed by `depth`, filled by `pane`.
struct Opening {
  double x0, x1, z0, z1, depth;
  Surface pane;
};

/// Wall in the plane y = 0 of `placement`. It is split at the openings of each row, so openings of
/// one row must share z0 and z1 bands.
void wall(const Placement& placement, double width, double height,
          const std::vector<std::vector<Opening>>& rows, Surface s, Mesh* building) {
  Mesh mesh;
  const auto panel = [&](double x0, double x1, double z0, double z1, double y, Surface surface_of) {
    if (x1 - x0 < 1e-3 || z1 - z0 < 1e-3) return;
    mesh.quad({f(x0), f(y), f(z0)}, {f(x1), f(y), f(z0)}, {f(x1), f(y), f(z1)},
              {f(x0), f(y), f(z1)}, surface_of);
  };
  double below = -1.5;  // foundations, because the ground slopes
  for (const auto& row : rows) {
    if (row.empty()) continue;
    double low = height, high = 0;
    for (const Opening& o : row) low = std::min(low, o.z0), high = std::max(high, o.z1);
    panel(0, width, below, low, 0, s);
    double x = 0;
    for (const Opening& o : row) {
      panel(x, o.x0, low, high, 0, s);
      panel(o.x0, o.x1, low, o.z0, 0, s);
      panel(o.x0, o.x1, o.z1, high, 0, s);
      panel(o.x0, o.x1, o.z0, o.z1, o.depth, o.pane);
      const float x0 = f(o.x0), x1 = f(o.x1), z0 = f(o.z0), z1 = f(o.z1), d = f(o.depth);
      mesh.quad({x0, 0, z0}, {x0, d, z0}, {x0, d, z1}, {x0, 0, z1}, s);
      mesh.quad({x1, 0, z0}, {x1, d, z0}, {x1, d, z1}, {x1, 0, z1}, s);
      mesh.quad({x0, 0, z0}, {x1, 0, z0}, {x1, d, z0}, {x0, d, z0}, s);
      mesh.quad({x0, 0, z1}, {x1, 0, z1}, {x1, d, z1}, {x0, d, z1}, s);
      x = o.x1;
    }
    panel(x, width, low, high, 0, s);
    below = high;
  }
  panel(0, width, below, height, 0, s);
  building->append(mesh, placement);
}

struct FacadeStyle {
  double bay, window_width, sill, window_height, recess;  // [m]
  double shutters;                                        // fraction of windows with closed blinds
};

std::vector<std::vector<Opening>> windows(Random& random, const BuildingStyle& style,
                                          const FacadeStyle& facade, double width, bool front) {
  const int bays = std::max(1, static_cast<int>((width - 0.6) / facade.bay));
  const double margin = (width - bays * facade.bay) / 2;
  const int door = front ? random.integer(0, bays - 1) : -1;
  const int garage =
      front && !style.shop && bays >= 3 && random.chance(0.3) ? (door == 0 ? bays - 1 : 0) : -1;
  const Surface glass = surface(Material::kGlass, 0.1, Look::kWindow);
  std::vector<std::vector<Opening>> rows;
  for (int floor = 0; floor < style.floors; ++floor) {
    std::vector<Opening> row;
    const double base = floor * style.floor_height;
    for (int i = 0; i < bays; ++i) {
      const double middle = margin + (i + 0.5) * facade.bay;
      const auto opening = [&](double w, double z0, double z1, double depth, Surface pane) {
        w = std::min(w, facade.bay - 0.15);
        row.push_back({middle - w / 2, middle + w / 2, base + z0, base + z1, depth, pane});
      };
      if (floor == 0 && i == door) {
        const Surface leaf = surface(Material::kSolid, random.uniform(0.15, 0.5), Look::kDoor);
        const double wide = random.uniform(1.0, 1.5);
        opening(wide, 0.0, 2.2, random.uniform(0.2, 0.8), leaf);
      } else if (floor == 0 && i == garage) {
        opening(2.6, 0.0, 2.2, random.uniform(0.1, 0.5),
                surface(Material::kSolid, 0.4, Look::kGarageDoor));
      } else if (floor == 0 && style.shop && front) {
        opening(facade.bay - 0.4, 0.4, 2.5, 0.3, glass);
      } else if (!random.chance(front ? 0.08 : 0.35)) {
        const bool closed = random.chance(facade.shutters);
        opening(facade.window_width * (random.chance(0.15) ? 0.6 : 1), facade.sill,
                facade.sill + facade.window_height, closed ? 0.06 : facade.recess,
                closed ? surface(Material::kSolid, 0.45, Look::kShutter) : glass);
      }
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

void add_relief(Random& random, const BuildingStyle& style, double height, Surface wall_surface,
                Mesh* mesh) {
  const double w = style.width;
  const auto box = [&](double x0, double x1, double out, double z0, double z1, Surface s) {
    mesh->box({f(std::max(0.0, x0)), f(-out), f(z0)}, {f(std::min(w, x1)), 0, f(z1)}, s);
  };
  const Surface stone = surface(Material::kSolid, random.uniform(0.25, 0.5), Look::kStone);
  const Surface metal = surface(Material::kSolid, 0.4);
  if (random.chance(0.5)) box(0, w, 0.06, -1.5, random.uniform(0.4, 0.9), stone);
  if (random.chance(0.5)) {
    const double x = random.uniform(0, w - 1.5);
    const int steps = random.integer(1, 3);
    for (int i = 0; i < steps; ++i) box(x, x + 1.5, 0.3 * (steps - i), -0.5, 0.17 * (i + 1), stone);
  }
  if (random.chance(0.3) && w > 7) {
    const double x = random.uniform(0.5, w - 3.5), top = random.chance(0.5) ? 2.8 : height - 0.5;
    const double wide = random.uniform(1.8, 3);
    box(x, x + wide, random.uniform(0.5, 1.0), -0.5, top, wall_surface);
  }
  if (random.chance(0.35)) {
    const double x = random.uniform(0, w - 2);
    mesh->box({f(x), -1.0f, 2.4f}, {f(x + 2), 0, 2.55f}, metal);  // canopy above a door
    for (const double post : {x + 0.05, x + 1.9})
      if (random.chance(0.5)) mesh->box({f(post), -1.0f, 0}, {f(post + 0.08), -0.92f, 2.4f}, metal);
  }
  if (style.floors > 1 && random.chance(0.5)) {
    const double width = random.uniform(2, 4), x = random.uniform(0.2, std::max(0.3, w - width));
    for (int floor = 1; floor < style.floors; ++floor) {
      const double z = floor * style.floor_height;
      box(x, x + width, 1.0, z - 0.15, z, stone);
      mesh->quad({f(x), -1.0f, f(z)}, {f(std::min(w, x + width)), -1.0f, f(z)},
                 {f(std::min(w, x + width)), -1.0f, f(z + 0.95)}, {f(x), -1.0f, f(z + 0.95)},
                 metal);
    }
  }
  for (const double x : {0.25, w - 0.25})
    if (random.chance(0.5)) mesh->cylinder({f(x), -0.1f, -0.2f}, 0.05f, 0.05f, f(height), 6, metal);
}

void add_roof(Random& random, const BuildingStyle& style, double height, Mesh* mesh) {
  const Surface tiles = surface(Material::kSolid, random.uniform(0.15, 0.4), Look::kRoof);
  const Surface wall_surface = surface(Material::kSolid, random.uniform(0.3, 0.6), Look::kWall);
  const float x0 = 0, x1 = f(style.width), y0 = 0, y1 = f(style.depth), z = f(height);
  const float eaves = f(random.uniform(0.2, 0.5));
  const double kind = random.uniform();
  if (kind < 0.25 || style.shop) {  // flat, with a parapet
    const float parapet = f(random.uniform(0.2, 0.9));
    mesh->quad({x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}, tiles);
    mesh->box({x0, y0, z}, {x1, y0 + 0.2f, z + parapet}, wall_surface);
    if (random.chance(0.5))
      mesh->box({x1 * 0.3f, y1 * 0.4f, z}, {x1 * 0.5f, y1 * 0.7f, z + 2}, tiles);
    return;
  }
  const double pitch = random.uniform(0.45, 1.0);
  const bool along = kind < 0.7;  // ridge along the street; else gables face it
  const float rise = f(pitch * (along ? style.depth : style.width) / 2);
  const float xm = x1 / 2, ym = y1 / 2, top = z + rise;
  if (along) {
    const float hip = random.chance(0.3) ? std::min(xm, ym) * 0.8f : 0;
    const Vec a(x0 - eaves, y0 - eaves, z - eaves * f(pitch)), b(x1 + eaves, a.y(), a.z());
    const Vec c(b.x(), y1 + eaves, a.z()), d(a.x(), c.y(), a.z());
    const Vec r0(x0 + hip - eaves, ym, top), r1(x1 - hip + eaves, ym, top);
    mesh->quad(a, b, r1, r0, tiles);
    mesh->quad(c, d, r0, r1, tiles);
    mesh->triangle({x0, y0, z}, {x0, y1, z}, {x0 + hip, ym, top}, hip > 0 ? tiles : wall_surface);
    mesh->triangle({x1, y0, z}, {x1, y1, z}, {x1 - hip, ym, top}, hip > 0 ? tiles : wall_surface);
    for (double x = 2; random.chance(0.6) && x + 2 < style.width; x += random.uniform(3, 5))
      mesh->box({f(x), 0.4f, z}, {f(x + 1.6), ym, z + std::min(rise * 0.8f, 1.8f)}, wall_surface);
  } else {
    const Vec a(x0 - eaves, y0 - eaves, z), b(x0 - eaves, y1 + eaves, z);
    const Vec c(x1 + eaves, y0 - eaves, z), d(x1 + eaves, y1 + eaves, z);
    const Vec r0(xm, y0 - eaves, top), r1(xm, y1 + eaves, top);
    mesh->quad(a, b, r1, r0, tiles);
    mesh->quad(c, d, r1, r0, tiles);
    mesh->triangle({x0, y0, z}, {x1, y0, z}, {xm, y0, top}, wall_surface);
    mesh->triangle({x0, y1, z}, {x1, y1, z}, {xm, y1, top}, wall_surface);
  }
  const float cx = f(style.width * random.uniform(0.2, 0.8));
  mesh->box({cx, ym - 0.4f, z}, {cx + 0.7f, ym + 0.4f, top + 0.8f}, wall_surface);
}

}  // namespace

Mesh make_building(Random& random, const BuildingStyle& style) {
  Mesh mesh;
  const double height = style.floors * style.floor_height + random.uniform(0, 0.6);
  const Surface plaster = surface(Material::kSolid, random.uniform(0.25, 0.65), Look::kWall);
  constexpr double kQuarter = 1.5707963267948966;
  if (style.detailed) {
    const FacadeStyle facade{random.uniform(2.2, 3.8),  random.uniform(0.9, 1.7),
                             random.uniform(0.6, 1.1),  random.uniform(1.2, 1.6),
                             random.uniform(0.08, 0.3), random.uniform(0, 0.5)};
    // Each wall has its own frame, with y pointing into the house.
    const std::array<Vec, 4> corners = {Vec::Zero(), Vec(f(style.width), 0, 0),
                                        Vec(f(style.width), f(style.depth), 0),
                                        Vec(0, f(style.depth), 0)};
    for (int side = 0; side < 4; ++side) {
      const double width = side % 2 ? style.depth : style.width;
      wall({corners[static_cast<size_t>(side)], side * kQuarter}, width, height,
           windows(random, style, facade, width, side == 0), plaster, &mesh);
    }
    add_relief(random, style, height, plaster, &mesh);
  } else {
    mesh.box({0, 0, -1.5f}, {f(style.width), f(style.depth), f(height)}, plaster);
  }
  add_roof(random, style, height, &mesh);
  return mesh;
}

}  // namespace revisit::simulation
