"""Plans for the meshes of a job, which depend on meshes and tools alone, not on the clips that are baked."""

from wrinklecli.baking.job import Job
from wrinklecli.character.contacts import Neighbours
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.plan import plan_mesh
from wrinklecli.errors import BakeError, WrinkleError


def plan_meshes(job: Job, *, influences: int | None = None) -> list[MeshPlan]:
    """Attach the tools of every mesh and refine it, as `plan_mesh` does.

    Raises:
        WrinkleError: Tools do not fit, a line for each.
    """
    plans: list[MeshPlan] = []
    problems: list[WrinkleError] = []
    neighbours = Neighbours(job.document)
    for node, tools in job.by_node.items():
        try:
            plan = plan_mesh(
                job.document,
                node,
                tools,
                job.settings,
                job.every_clip,
                job.options.max_error,
                influences=influences,
                max_vertices=job.options.max_vertices,
                neighbours=neighbours,
            )
        except WrinkleError as error:
            problems.append(error)
        else:
            plans.append(plan)
    if problems:
        # A fault of the whole file is a fault of each mesh.
        raise problems[0] if len({str(each) for each in problems}) == 1 else BakeError.of_all(problems)
    return plans
