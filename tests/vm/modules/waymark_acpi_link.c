// SPDX-License-Identifier: GPL-2.0
// Gives vhci-hcd's controller an ACPI node. libcamera names a USB camera by the ACPI node of what
// it is attached to, and passes over cameras without.
#include <linux/acpi.h>
#include <linux/device.h>
#include <linux/module.h>
#include <linux/platform_device.h>

static char *device = "vhci_hcd.0";
module_param(device, charp, 0444);
MODULE_PARM_DESC(device, "platform device to link");

static char *node = "PNP0A08";
module_param(node, charp, 0444);
MODULE_PARM_DESC(node, "hardware id of the ACPI node");

static struct device *linked;

static int __init waymark_acpi_link_init(void)
{
	struct acpi_device *acpi;
	int error;

	linked = bus_find_device_by_name(&platform_bus_type, NULL, device);
	acpi = acpi_dev_get_first_match_dev(node, NULL, -1);
	error = linked && acpi ? acpi_bind_one(linked, acpi) : -ENODEV;
	acpi_dev_put(acpi);
	if (error) {
		pr_err("waymark_acpi_link: %s to %s: %d\n", device, node, error);
		put_device(linked);
	}
	return error;
}

static void __exit waymark_acpi_link_exit(void)
{
	acpi_unbind_one(linked);
	put_device(linked);
}

module_init(waymark_acpi_link_init);
module_exit(waymark_acpi_link_exit);
MODULE_LICENSE("GPL");
MODULE_DESCRIPTION("Links a platform device to an ACPI node");
