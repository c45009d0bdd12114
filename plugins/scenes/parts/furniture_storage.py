"""Beds and storage furniture: wardrobes, cabinets, shelves, and the television's board."""

from deux_plugins.scenes.parts.furniture_clutter import book_pile, book_row, bowl, carton, table_lamp, vase
from deux_plugins.scenes.parts.shapes import Model
from deux_plugins.scenes.parts.style import Style
from deux_plugins.scenes.parts.surfaces import Surface


def bed(style: Style, width: float) -> Model:
    """A single or double bed with its head at the wall."""
    depth = style.draws.uniform(1.95, 2.1)
    wood, cover, sheet = style.wood(), style.linen(), style.linen()
    head = style.draws.uniform(0.8, 1.15)
    model = Model("bed", width, depth, head, front=0.3)
    half = width / 2
    model.box((-half, 0.0, 0.0), (half, head, 0.06), wood, front=style.upholstery())
    model.box((-half + 0.01, 0.0, 0.06), (half - 0.01, 0.3, depth), wood)
    model.box((-half + 0.03, 0.3, 0.06), (half - 0.03, 0.48, depth - 0.03), sheet)
    model.box((-half + 0.005, 0.26, 0.62), (half - 0.005, 0.54, depth + 0.005), cover)
    count = 1 if width < 1.2 else 2
    for index in range(count):
        left = -half + 0.06 + index * (width - 0.12) / count
        right = left + (width - 0.12) / count - 0.05
        model.box((left, 0.47, 0.12), (right, 0.6, 0.5), style.linen(), label="cushion")
    return model


def nightstand(style: Style) -> Model:
    """A small cabinet beside a bed, with a lamp or books."""
    model = _chest("nightstand", 0.44, 0.38, style.draws.uniform(0.45, 0.55), (1, 2), style)
    model.add(style.draws.choice((table_lamp, book_pile, vase))(style), 0.0, model.height, 0.1)
    return model


def wardrobe(style: Style) -> Model:
    """A wardrobe with two to four doors."""
    doors = style.draws.integer(2, 4)
    width, height = doors * style.draws.uniform(0.42, 0.52), style.draws.uniform(1.95, 2.2)
    model = Model("wardrobe", width, 0.6, height, front=0.4)
    body, front = style.wood(), style.front()
    model.box((-width / 2, 0.0, 0.0), (width / 2, height, 0.57), body)
    _fronts(model, (0.1, height - 0.06), doors, 1, 0.57, front, style.metal())
    return model


def dresser(style: Style) -> Model:
    """A chest of drawers with things on top."""
    model = _chest("cabinet", style.draws.uniform(0.8, 1.3), 0.45, style.draws.uniform(0.75, 0.95), (2, 3), style)
    model.front = 0.35
    for x in (-0.25, 0.2):
        model.add(style.draws.choice((table_lamp, book_pile, vase, carton, bowl))(style), x, model.height, 0.12)
    return model


def shoe_cabinet(style: Style) -> Model:
    """A shallow cabinet for hallways."""
    model = _chest("cabinet", style.draws.uniform(0.7, 1.0), 0.24, style.draws.uniform(0.8, 1.0), (2, 2), style)
    model.add(style.draws.choice((bowl, vase, carton))(style), style.draws.uniform(-0.2, 0.2), model.height, 0.03)
    return model


def bookshelf(style: Style) -> Model:
    """Open shelves full of books and small things."""
    width, depth = style.draws.uniform(0.75, 1.25), style.draws.uniform(0.27, 0.34)
    count = style.draws.integer(4, 6)
    step = style.draws.uniform(0.31, 0.37)
    height = count * step + 0.1
    model = Model("shelf", width, depth, height, front=0.3)
    wood, half, board = style.wood(), width / 2, 0.025
    for left in (-half, half - board):
        model.box((left, 0.0, 0.0), (left + board, height, depth), wood)
    model.box((-half + board, 0.02, 0.002), (half - board, height - 0.01, 0.012), style.wood())
    for index in range(count + 1):
        foot = 0.06 + index * step
        model.box((-half + board, foot, 0.012), (half - board, foot + board, depth - 0.005), wood)
        if index < count:
            model.add(book_row(style, width - 2 * board - 0.02, depth, step - board), 0.0, foot + board, 0.015)
    return model


def wall_shelf(style: Style) -> Model:
    """A board on the wall with a row of books."""
    width = style.draws.uniform(0.6, 1.1)
    model = Model("shelf", width, 0.22, 0.3, hangs=True)
    model.box((-width / 2, 0.0, 0.0), (width / 2, 0.025, 0.22), style.wood())
    model.box((-width / 2, -0.06, 0.0), (width / 2, 0.0, 0.02), style.metal())
    model.add(book_row(style, width - 0.06, 0.2, 0.27), 0.0, 0.025, 0.01)
    return model


def television(style: Style) -> Model:
    """A low cabinet with a television on it."""
    model = _chest("cabinet", style.draws.uniform(1.2, 1.7), 0.4, style.draws.uniform(0.4, 0.55), (3, 1), style)
    half, foot = style.draws.uniform(0.45, 0.58), model.height
    model.box((-0.2, foot + 0.002, 0.1), (0.2, foot + 0.02, 0.3), style.metal(), label="tv")
    model.box((-0.04, foot + 0.02, 0.17), (0.04, foot + 0.1, 0.2), style.metal(), label="tv")
    model.box(
        (-half, foot + 0.08, 0.18),
        (half, foot + 0.1 + half * 1.1, 0.22),
        style.metal(),
        front=style.picture(),
        label="tv",
    )
    model.height = round(foot + 0.1 + half * 1.1, 3)
    return model


def _chest(label: str, width: float, depth: float, height: float, grid: tuple[int, int], style: Style) -> Model:
    """A cabinet with columns x rows of drawers or doors under a board."""
    model = Model(label, width, depth, height)
    body, half = style.wood(), width / 2
    model.box((-half + 0.01, 0.0, 0.005), (half - 0.01, height - 0.025, depth - 0.025), body)
    model.box((-half, height - 0.025, 0.0), (half, height, depth), style.wood())
    _fronts(model, (0.06, height - 0.035), *grid, depth - 0.025, style.front(), style.metal())
    return model


def _fronts(
    model: Model, rise: tuple[float, float], columns: int, rows: int, z: float, front: Surface, knob: Surface
) -> None:
    """Add columns x rows doors or drawers with handles between two heights, in front of the face at z."""
    width, height = (model.width - 0.04) / columns, (rise[1] - rise[0]) / rows
    for column in range(columns):
        for row in range(rows):
            left, foot = -model.width / 2 + 0.02 + column * width, rise[0] + row * height
            model.box(
                (left + 0.006, foot + 0.006, z),
                (left + width - 0.006, foot + height - 0.006, z + 0.016),
                front,
            )
            x, y = left + width / 2, foot + height / 2
            if height > width:
                x += width * (0.36 if column % 2 == 0 else -0.36)
            model.box((x - 0.04, y - 0.01, z + 0.016), (x + 0.04, y + 0.01, z + 0.025), knob)
