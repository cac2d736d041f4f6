"""All plots of the report."""

from __future__ import annotations

from ..page.plot_style import INK, Plot, finish, new_figure
from .plot_functions import draw_functions, functions_panel
from .plot_images import bias_panel, draw_images
from .study import Study


def draw_all(study: Study) -> tuple[Plot, list[Plot], list[list[Plot]]]:
    """The main plot; one per shape as functions; some per shape as images."""
    functions = [draw_functions(study, one) for one in study.functions]
    shapes = list(dict.fromkeys(images.shape for images in study.images))
    return draw_main(study), functions, [draw_images(study, shape) for shape in shapes]


def draw_main(study: Study) -> Plot:
    """Functions and images of the first shape, side by side."""
    figure = new_figure(columns=2)
    left, right = figure.subplots(1, 2)
    functions = study.functions[0]
    functions_panel(left, study, functions)
    left.set_title("What accuracy costs in time", loc="left", fontsize=11, color=INK)
    shape = next((images.shape for images in study.images if images.shape == functions.shape.text), None)
    shape = shape or study.images[0].shape
    bias_panel(right, [images for images in study.images if images.shape == shape])
    right.set_title("What it buys in an image", loc="left", fontsize=11, color=INK)
    figure.suptitle(functions.shape.title, x=0.01, ha="left", fontsize=12, weight="bold", color=INK)
    return finish("accuracy", functions.shape.title, "", figure)
