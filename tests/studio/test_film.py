"""Laws of the page that plays by itself: it needs nothing else, and holds what the record holds."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
from recorded import moved_plan

from cableway.studio.film import film_page


def test_a_plan_plays_by_itself():
    task, plan = moved_plan(rows=5)
    page = film_page(replace(task, description="</script><b>"), plan, "</script><b>")
    assert not re.search(r"(src|href)=|https?:|import |fetch", page)
    assert page.count("</script>") == 1
    (data,) = re.findall(r"const film = (.*);", page)
    film = json.loads(data)
    assert len(film["cables"]) == len(film["times"]) == len(film["clearance"]) == plan.steps + 1
    np.testing.assert_allclose(film["ways"][1], plan.poses[:, 1, :2], atol=1e-4)
    ends = np.array([[line[0], line[-1]] for line in film["cables"]])
    np.testing.assert_allclose(ends, plan.shapes[:, [0, -1]], atol=1e-4)
    assert film["port"] is None
